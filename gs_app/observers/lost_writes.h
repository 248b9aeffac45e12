// SPDX-License-Identifier: Apache-2.0
// Files that a run could not write, mostly on a full disk, and that it goes on without.
#pragma once

#include <filesystem>
#include <functional>
#include <string>
#include <vector>

namespace gs {

/// Collects what was not written, and says it again at the end of the run.
class LostWrites {
 public:
  /// Runs write(). Returns whether it was done; if it throws an Error of the disk, warns that
  /// `what` was not written and training goes on. Where memory runs out, throws on.
  bool attempt(const std::string& what, const std::function<void()>& write);
  /// `what` was written by a later attempt.
  void forget(const std::string& what);
  /// A warning for each file that is still missing.
  void say_again() const;

 private:
  struct Loss {
    std::string what, why;
  };
  std::vector<Loss> losses_;
};

/// A file of comma-separated values whose first column is a step. It grows as a run goes on; rows
/// for which a full disk has no place are written with a later one.
class GrowingCsv {
 public:
  /// Starts the file with these rows. Throws Error.
  GrowingCsv(std::filesystem::path file, const std::string& header, const std::string& rows,
             LostWrites& lost);
  void add(const std::string& rows);
  /// Removes the rows of later steps.
  void cut_after(int step);
  /// All rows, without the header.
  std::string rows() const { return text_.substr(header_bytes_); }

 private:
  void write();

  std::filesystem::path path_;
  std::size_t header_bytes_;
  std::string text_;         // all that the file holds or should hold
  std::size_t written_ = 0;  // bytes of it that are in the file
  LostWrites& lost_;
};

}  // namespace gs
