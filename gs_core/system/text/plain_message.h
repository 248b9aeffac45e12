// SPDX-License-Identifier: Apache-2.0
// What an exception says to a user.
#pragma once

#include <exception>
#include <string>

namespace gs {

/// The message of any exception in a user's words: an Error's own, and for those of the library what
/// the system says, without names of C++.
std::string plain_message(const std::exception& error);

}  // namespace gs
