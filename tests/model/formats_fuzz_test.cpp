// SPDX-License-Identifier: Apache-2.0
// 10,000 damaged files for each reader of trained Gaussians (tests/support/damage.h). Some are
// damaged as they lie on disk. In others the packed data is damaged and packed again, so that no
// checksum protects the reader.
#include <gtest/gtest.h>

#include "gs_core/system/log.h"
#include "gs_core/threads/parallel.h"
#include "gs_model/formats/coding/compression.h"
#include "gs_model/formats/formats.h"
#include "gs_model/formats/sog/zip_file.h"
#include "gs_model/formats/spz/spz_layout.h"
#include "tests/support/damage.h"
#include "tests/support/random_model.h"
#include "tests/support/temp_folder.h"

namespace gs {
namespace {

/// What is damaged: the file, or (inside) its packed data.
struct Reader {
  const char* name;
  const char* ending;
  int sh_degree;
  ExportOptions options;
  std::string (*damaged_file)(const std::string& bytes, std::mt19937& random);
};

std::string damaged_outside(const std::string& bytes, std::mt19937& random) {
  return damaged(bytes, random);
}

std::string damaged_spz(const std::string& bytes, std::mt19937& random) {
  const std::size_t size = kSpzHeaderBytes + 4 * (9 + 1 + 3 + 3 + 4 + 9);
  return gzip(damaged(gunzip("", bytes, size, true), random));
}

std::string damaged_sog(const std::string& bytes, std::mt19937& random) {
  std::vector<ZipEntry> entries;
  for (const auto& [name, content] : zip_entries("", bytes))
    entries.push_back({name, std::string(content)});
  std::string& content = entries[random() % entries.size()].bytes;
  content = damaged(content, random);
  return zip_of(entries);
}

const Reader kReaders[] = {
    {"Ply", ".ply", 1, {}, damaged_outside},
    {"CompressedPly", ".compressed.ply", 1, {}, damaged_outside},
    {"Glb", ".glb", 1, {}, damaged_outside},
    {"Splat", ".splat", 0, {}, damaged_outside},
    {"Spz2", ".spz", 1, {2}, damaged_outside},
    {"Spz3", ".spz", 1, {3}, damaged_outside},
    {"Spz3Inside", ".spz", 1, {3}, damaged_spz},
    {"Spz4", ".spz", 1, {4}, damaged_outside},
    {"Sog", ".sog", 1, {}, damaged_outside},
    {"SogInside", ".sog", 1, {}, damaged_sog},
    {"Rad", ".rad", 1, {}, damaged_outside},
    {"Gs4d", ".gs4d", 1, {}, damaged_outside},
};

void PrintTo(const Reader& reader, std::ostream* out) { *out << reader.name; }

class FormatsFuzz : public testing::TestWithParam<Reader> {
 protected:
  static void SetUpTestSuite() { setup_log(Verbosity::quiet); }
};

TEST_P(FormatsFuzz, DamagedFilesAreReadOrRefused) {
  try {
    find_format(GetParam().ending)->require(GetParam().options);
  } catch (const Error& missing) {
    GTEST_SKIP() << missing.what();
  }
  const SerialLoops no_threads;  // as many tests as cores run at the same time
  const TempFolder folder;
  const auto file = folder.path() / (std::string("model") + GetParam().ending);
  const ModelFormat& format = *find_format(GetParam().ending);
  const GaussianModel model = format.gaussians == Holds::moving
                                  ? random_moving_model(4, GetParam().sh_degree)
                                  : random_model(4, GetParam().sh_degree);
  write_model(file, model, GetParam().options);
  const std::string bytes = read_bytes(file);
  EXPECT_EQ(read_model(file).gaussians.count(), 4u);
  const FuzzCases cases;
  for (unsigned number = cases.first; number < cases.first + cases.count; ++number) {
    std::mt19937 random(number);
    replace_bytes(file, GetParam().damaged_file(bytes, random));
    EXPECT_EQ(trouble_of([&] { read_model(file); }), "") << "case " << number;
  }
}

INSTANTIATE_TEST_SUITE_P(Readers, FormatsFuzz, testing::ValuesIn(kReaders),
                         [](const auto& info) { return std::string(info.param.name); });

}  // namespace
}  // namespace gs
