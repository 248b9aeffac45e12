// SPDX-License-Identifier: Apache-2.0
// Every file of corpus/ through its target, in builds of every compiler, so that what a fuzzer found
// once stays mended. tests/support/damage.h says what a reader may not do.
#include <gtest/gtest.h>

#include <algorithm>

#include "gs_core/system/log.h"
#include "tests/fuzz/fuzz_target.h"
#include "tests/support/damage.h"

namespace gs::fuzz {

void PrintTo(const Target& target, std::ostream* out) { *out << target.name; }

namespace {

namespace fs = std::filesystem;

const fs::path kCorpus = fs::path(GS_SOURCE_DIR) / "tests/fuzz/corpus";

constexpr double kMostSeconds = 5;  // for a file, as in scripts/fuzz.sh

class FuzzCorpus : public testing::TestWithParam<Target> {};

TEST_P(FuzzCorpus, EveryFileIsReadOrRefused) {
  detail::set_log_sink([](detail::LogLevel, std::string_view) {});
  std::size_t files = 0;
  for (const auto& entry : fs::directory_iterator(kCorpus / GetParam().name)) {
    const std::string bytes = read_bytes(entry.path());
    EXPECT_EQ(trouble_of([&] { GetParam().read(bytes); }, kMostSeconds), "") << entry.path();
    ++files;
  }
  EXPECT_GT(files, 0u);
}

INSTANTIATE_TEST_SUITE_P(Targets, FuzzCorpus, testing::ValuesIn(targets()),
                         [](const auto& info) { return std::string(info.param.name); });

TEST(FuzzTargets, EachFolderOfTheCorpusHasATarget) {
  for (const auto& entry : fs::directory_iterator(kCorpus))
    EXPECT_TRUE(std::any_of(targets().begin(), targets().end(), [&](const Target& target) {
      return entry.path().filename() == target.name;
    })) << entry.path();
}

}  // namespace
}  // namespace gs::fuzz
