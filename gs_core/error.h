// SPDX-License-Identifier: Apache-2.0
// Two kinds of failure: of the world outside (`throw Error`; main shows the message) and of this
// program (`GS_CHECK`).
#pragma once

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

namespace detail {
[[noreturn]] void check_failed(const char* condition, const char* file, int line);
}

/// States a condition that holds if this program is correct. A failure is a bug, never the user's
/// fault.
#define GS_CHECK(condition) \
  ((condition) ? (void)0 : ::gs::detail::check_failed(#condition, __FILE__, __LINE__))

}  // namespace gs
