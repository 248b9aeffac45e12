// SPDX-License-Identifier: Apache-2.0
// What this program has put into a folder that also holds files of the user's. This is the one place
// that decides which of them may be replaced or removed.
#pragma once

#include <filesystem>
#include <functional>
#include <map>
#include <string>
#include <vector>

namespace gs {

/// Size and time of the last change of a file, "12345 1700000000123456789"; empty if there is none.
std::string stamp_of(const std::filesystem::path& file);

/// A list of files in a folder that are ours. A file gets onto the list, and the list onto the disk,
/// before the file is made; so a kill at any moment leaves no file of ours that is not on the list,
/// and no file of the user's that is.
///
///   files.claim({{"database.db", ""}});        // refuses if such a file is there and not ours
///   files.place({{"images/a.png", "/photos/a.png"}}, work);
///   files.remove_all();                        // what is ours and unchanged, and nothing else
class OwnedFiles {
 public:
  /// Names are relative to the folder, with "/" between folders. The stamp of a file (stamp_of())
  /// says which content is ours; an empty one means any.
  using Stamps = std::map<std::string, std::string>;
  /// Writes the list to the disk.
  using Save = std::function<void(const Stamps& files)>;

  /// Names that lead out of the folder are dropped: the list comes from a file.
  OwnedFiles(std::filesystem::path folder, const Stamps& files, Save save);

  /// Puts names onto the list and saves it. Throws UsageError, and changes nothing, if something
  /// has one of the names and is not ours.
  void claim(const Stamps& files);
  /// Claims names and fills them by hard links to files, or by copies, which are made in work(),
  /// where the file system has no links. `sources` are by name. Names that have the same content
  /// already are passed over. Throws UsageError as claim(), and Error if the disk is full.
  void place(const std::map<std::string, std::filesystem::path>& sources,
             const std::function<std::filesystem::path()>& work);
  /// Takes names that begin so off the list: those files are the user's from now on.
  void forget(const std::string& beginning);
  /// Whether there is something with this name, and it is ours and unchanged.
  bool holds(const std::string& name) const;
  /// Removes all files of the list that are ours and unchanged, then the folders that are empty
  /// without them. The list is empty afterwards.
  void remove_all();
  const Stamps& names() const { return files_; }

 private:
  std::filesystem::path path(const std::string& name) const { return folder_ / name; }
  [[noreturn]] void refuse(const std::string& name) const;
  bool is_reached_without_links(const std::string& name) const;

  std::filesystem::path folder_;
  Stamps files_;
  Save save_;
};

/// A new folder in `parent` that only this program uses, ".gemsplat-XXXXXX". Throws Error.
std::filesystem::path make_work_folder(const std::filesystem::path& parent);

/// Whether a name has the form of those folders. Other names may come from a damaged file.
bool is_work_folder(const std::string& name);

/// Removes such a folder with all that it holds. Returns whether nothing of it is left.
bool remove_work_folder(const std::filesystem::path& folder);

}  // namespace gs
