// SPDX-License-Identifier: Apache-2.0
// Every file of corpus/ through its target, in builds of every compiler, so that what a fuzzer found
// once stays mended; and the same files damaged. tests/support/damage.h says what a reader may not do.
#include <gtest/gtest.h>

#include <algorithm>

#include "gs_core/system/log.h"
#include "gs_core/threads/parallel.h"
#include "tests/fuzz/fuzz_target.h"
#include "tests/support/damage.h"

namespace gs::fuzz {

void PrintTo(const Target& target, std::ostream* out) { *out << target.name; }

namespace {

namespace fs = std::filesystem;

const fs::path kCorpus = fs::path(GS_SOURCE_DIR) / "tests/fuzz/corpus";

constexpr double kMostSeconds = 5;  // for a file, as in scripts/fuzz.sh

class FuzzCorpus : public testing::TestWithParam<Target> {
 protected:
  FuzzCorpus() {
    detail::set_log_sink([](detail::LogLevel, std::string_view) {});
    for (const auto& entry : fs::directory_iterator(kCorpus / GetParam().name))
      files_.push_back(entry.path());
    std::sort(files_.begin(), files_.end());
  }
  static std::string trouble(const std::string& bytes) {
    return trouble_of([&] { GetParam().read(bytes); }, kMostSeconds);
  }
  std::vector<fs::path> files_;
};

TEST_P(FuzzCorpus, EveryFileIsReadOrRefused) {
  ASSERT_FALSE(files_.empty());
  for (const fs::path& file : files_) EXPECT_EQ(trouble(read_bytes(file)), "") << file;
}

TEST_P(FuzzCorpus, DamagedFilesAreReadOrRefused) {
  const SerialLoops no_threads;
  const FuzzCases cases;
  for (unsigned number = cases.first; number < cases.first + cases.count; ++number) {
    std::mt19937 random(number);
    const fs::path& file = files_[number % files_.size()];
    EXPECT_EQ(trouble(damaged(read_bytes(file), random)), "") << file << ", case " << number;
  }
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
