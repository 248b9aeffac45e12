// SPDX-License-Identifier: Apache-2.0
// Tests of files.
#pragma once

#include <gtest/gtest.h>

#include <filesystem>
#include <string>

#include "tests/support/temp_folder.h"

namespace gs {

/// A test with a folder of its own, which is removed after it.
class FolderTest : public testing::Test {
 protected:
  const std::filesystem::path& folder() const { return temp_.path(); }
  std::filesystem::path path(const std::string& name) const { return folder() / name; }

 private:
  TempFolder temp_;
};

}  // namespace gs
