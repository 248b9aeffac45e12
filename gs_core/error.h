// SPDX-License-Identifier: Apache-2.0
// Two kinds of failure: of the world outside (`throw Error`; main shows the message) and of this
// program (`GS_CHECK`).
#pragma once

#include <exception>
#include <stdexcept>
#include <string>

namespace gs {

/// What the program returns to the shell.
enum class ExitCode : int {
  done = 0,
  bug = 1,            // a GS_CHECK failed
  usage = 2,          // the command line or a config value cannot be used
  bad_data = 3,       // a file or a data set cannot be used
  out_of_memory = 4,  // after every fallback
  interrupted = 5,    // stopped by a signal, work saved
};

/// Text that is safe on a terminal, and of a sensible length: fit_for_terminal() in foreign_text.h.
/// Messages quote files, and files may hold any bytes.
std::string printable(std::string text);

/// The message of any exception in a user's words: an Error's own, and for those of the library what
/// the system says, without names of C++.
std::string plain_message(const std::exception& error);

/// A failure of the world outside, such as a damaged file. The message says what happened, to which
/// file or value, and what to try. Thrown anywhere, caught once, in main().
class Error : public std::runtime_error {
 public:
  explicit Error(const std::string& message, ExitCode code = ExitCode::bad_data)
      : std::runtime_error(printable(message)), code_(code) {}
  ExitCode code() const { return code_; }

 private:
  ExitCode code_;
};

/// A config value or command line that cannot be used.
class UsageError : public Error {
 public:
  explicit UsageError(const std::string& message) : Error(message, ExitCode::usage) {}
};

/// A file or folder that the system does not let us read: the disk fails, too many files are open, a
/// right is missing. Its content may be fine. So nothing may follow from it, as it may from a
/// damaged file, which is an Error of its own.
class AccessError : public Error {
 public:
  explicit AccessError(const std::string& message) : Error(message) {}
};

namespace detail {
[[noreturn]] void check_failed(const char* condition, const char* file, int line);
}

/// States a condition that holds if this program is correct. A failure is a bug, never the user's
/// fault.
#define GS_CHECK(condition) \
  ((condition) ? (void)0 : ::gs::detail::check_failed(#condition, __FILE__, __LINE__))

}  // namespace gs
