// SPDX-License-Identifier: Apache-2.0
// Files of trained Gaussians other than PLY: what reading returns of a written model, also at the
// limits of a format.
#include "gs_model/formats/formats.h"

#include <gmock/gmock.h>
#include <spdlog/fmt/fmt.h>

#include <cmath>
#include <cstring>
#include <numbers>

#include "gs_core/system/crc32.h"
#include "gs_core/system/log.h"
#include "gs_model/formats/coding/compression.h"
#include "gs_model/formats/coding/finite_rows.h"
#include "gs_model/formats/coding/little_endian.h"
#include "gs_model/formats/coding/quantize.h"
#include "gs_model/formats/coding/zip_file.h"
#include "gs_model/formats/foreign_files.h"
#include "gs_model/formats/ply/ply.h"
#include "gs_model/formats/spz/spz_layout.h"
#include "tests/support/error_of.h"
#include "tests/support/models.h"
#include "tests/support/random_model.h"
#include "tests/support/temp_folder.h"

namespace gs {
namespace {

using testing::AllOf;
using testing::HasSubstr;

/// The largest difference that a lossy format may cause: twice the largest rounding error for
/// random_model().
struct Tolerance {
  float mean, log_scale, opacity, sh0, sh_rest, angle;  // angle: radians
};

/// Files of one kind, and the loss that is allowed for a random model.
struct Kind {
  const char* ending;
  ExportOptions options;
  int most_sh_degree;
  Tolerance tolerance;
};

// .sog stores SH as a palette, which random numbers do not fit; a test below checks them. The axes of
// an .npz come in another order: npz_test.cpp.
const Kind kKinds[] = {
    {".compressed.ply", {}, 3, {0.008f, 0.008f, 0.003f, 0.03f, 0.032f, 0.008f}},
    {".glb", {}, 3, {0, 1e-5f, 1e-6f, 0, 0, 2e-3f}},
    {".usda", {}, 3, {0, 1e-5f, 1e-6f, 0, 0, 2e-3f}},
    {".usdc", {}, 3, {0, 1e-5f, 1e-6f, 0, 0, 2e-3f}},
    {".usdz", {}, 3, {0, 1e-5f, 1e-6f, 0, 0, 2e-3f}},
    {".splat", {}, 0, {0, 1e-6f, 0.003f, 0.015f, 0, 0.02f}},
    {".spz", {3}, 3, {0.00025f, 0.064f, 0.003f, 0.03f, 0.135f, 0.006f}},
    {".spz", {2}, 3, {0.00025f, 0.064f, 0.003f, 0.03f, 0.135f, 0.25f}},
    {".spz", {3, 8}, 3, {0.00025f, 0.064f, 0.003f, 0.03f, 0.008f, 0.006f}},
    {".spz", {4}, 3, {0.00025f, 0.064f, 0.003f, 0.03f, 0.135f, 0.006f}},
    {".sog", {}, 3, {0.0004f, 0.06f, 0.003f, 0.06f, 100, 0.02f}},
    {".rad", {}, 3, {0, 0.005f, 0.0005f, 0.004f, 0.01f, 0.045f}},
    {".extreme_saving.zip", {}, 3, {0, 0.004f, 0.001f, 0.004f, 0.004f, 0.002f}},
};

float angle_between(const Quatf& a, const Quatf& b) {
  const float dot = std::abs(a.w * b.w + a.x * b.x + a.y * b.y + a.z * b.z);
  return 2 * std::acos(std::min(1.0f, dot));
}

float largest(const Vec3f& v) { return std::max({std::abs(v.x), std::abs(v.y), std::abs(v.z)}); }

/// A model that every format can hold: colors and SH within the ranges of bytes, all means
/// different.
GaussianModel moderate_model(std::size_t count, int sh_degree) {
  GaussianModel model = random_model(count, sh_degree);
  for (Vec3f& f : model.gaussians.sh0)
    f = 1.7f * Vec3f(std::tanh(f.x), std::tanh(f.y), std::tanh(f.z));
  for (ShRest& rest : model.gaussians.sh_rest)
    for (Vec3f& c : rest.coefficient) c *= 0.2f;
  return model;
}

class Formats : public testing::Test {
 protected:
  static void SetUpTestSuite() { setup_log(Verbosity::quiet); }
  void SetUp() override {
    try {
      for (const ModelFormat& format : model_formats())
        for (const int version : {3, 4}) format.require({version});
    } catch (const Error& missing) {
      GTEST_SKIP() << missing.what();
    }
  }
  std::filesystem::path file(const std::string& name) const { return folder_.path() / name; }
  GaussianModel there_and_back(const GaussianModel& model, const std::string& ending,
                               const ExportOptions& options = {}) const {
    write_model(file(std::string("model").append(ending)), model, options);
    return read_model(file(std::string("model").append(ending)));
  }
  /// Expects each row of `back` to be within the tolerance of the nearest row of `model`.
  static void expect_near(const GaussianModel& back, const GaussianModel& model,
                          const Tolerance& tolerance) {
    ASSERT_EQ(back.gaussians.count(), model.gaussians.count());
    const Gaussians &a = back.gaussians, &b = model.gaussians;
    for (std::size_t i = 0; i < a.count(); ++i) {
      std::size_t j = 0;
      for (std::size_t k = 1; k < b.count(); ++k)
        if (largest(a.mean[i] - b.mean[k]) < largest(a.mean[i] - b.mean[j])) j = k;
      ASSERT_LE(largest(a.mean[i] - b.mean[j]), tolerance.mean) << i;
      EXPECT_LE(largest(a.log_scale[i] - b.log_scale[j]), tolerance.log_scale) << i;
      EXPECT_LE(std::abs(sigmoid(a.logit_opacity[i]) - sigmoid(b.logit_opacity[j])),
                tolerance.opacity)
          << i;
      EXPECT_LE(largest(a.sh0[i] - b.sh0[j]), tolerance.sh0) << i;
      EXPECT_LE(angle_between(a.rotation[i], b.rotation[j]), tolerance.angle) << i;
      for (int k = 0; k < sh_rest_count(back.sh_degree); ++k)
        EXPECT_LE(largest(a.sh_rest[i].coefficient[k] - b.sh_rest[j].coefficient[k]),
                  tolerance.sh_rest)
            << i << " " << k;
    }
  }

  TempFolder folder_;
};

TEST_F(Formats, LosslessOnesComeBackBitByBit) {
  for (const ModelFormat& format : model_formats()) {
    if (!format.is_lossless) continue;
    for (int degree = 0; degree <= kMaxShDegree; ++degree) {
      SCOPED_TRACE(std::string(format.name) + " " + std::to_string(degree));
      GaussianModel model = random_model(300, degree);
      // a zero with a sign, a denormal, nearly the largest float
      model.gaussians.mean[0] = {-0.0f, 1e-40f, 3.4e38f};
      model.gaussians.log_scale[1] = {-1e30f, 0.1f, 7};
      for (Quatf& q : model.gaussians.rotation) normalize(&q.w);
      const GaussianModel back = there_and_back(model, std::string(format.ending));
      EXPECT_EQ(back.sh_degree, degree);
      EXPECT_TRUE(same_bits(back.gaussians, model.gaussians));
    }
  }
}

TEST_F(Formats, LossyOnesComeBackNearlyAtEveryDegree) {
  for (const Kind& kind : kKinds) {
    for (int degree = 0; degree <= kMaxShDegree; ++degree) {
      SCOPED_TRACE(std::string(kind.ending) + " " + std::to_string(degree));
      const GaussianModel model = moderate_model(600, degree);  // three chunks of a compressed PLY
      const GaussianModel back = there_and_back(model, kind.ending, kind.options);
      EXPECT_EQ(back.sh_degree, std::min(degree, kind.most_sh_degree));
      expect_near(back, model, kind.tolerance);
    }
  }
}

TEST_F(Formats, OneGaussianIsEnough) {
  for (const Kind& kind : kKinds) {
    SCOPED_TRACE(kind.ending);
    const GaussianModel model = moderate_model(1, 3);
    Tolerance tolerance = kind.tolerance;
    tolerance.sh_rest = std::min(tolerance.sh_rest, 0.135f);  // a palette with one entry
    expect_near(there_and_back(model, kind.ending, kind.options), model, tolerance);
  }
}

TEST_F(Formats, NoGaussiansAreHeldOrRefusedWithAdvice) {
  for (const char* ending : {".ply", ".compressed.ply", ".spz"}) {
    SCOPED_TRACE(ending);
    EXPECT_EQ(there_and_back(random_model(0, 2), ending).gaussians.count(), 0u);
  }
  for (const char* ending :
       {".glb", ".sog", ".npz", ".splat", ".rad", ".usda", ".usdc", ".usdz", ".extreme_saving.zip"})
    EXPECT_THAT(
        error_of([&] { write_model(file(std::string("none") + ending), random_model(0, 2)); }),
        AllOf(HasSubstr("no Gaussians"), HasSubstr("choose .ply")));
  write_bytes(file("empty.splat"), "");
  EXPECT_THAT(error_of([&] { read_model(file("empty.splat")); }), HasSubstr("it is empty"));
}

/// A model that the format can hold.
GaussianModel model_for(const ModelFormat& format, std::size_t count, int sh_degree) {
  return format.gaussians == Holds::moving ? random_moving_model(count, sh_degree)
                                           : moderate_model(count, sh_degree);
}

TEST_F(Formats, SameModelGivesSameBytes) {
  for (const ModelFormat& format : model_formats()) {
    const GaussianModel model = model_for(format, 500, 3);
    const std::string ending(format.ending);
    write_model(file(std::string("a").append(ending)), model);
    write_model(file(std::string("b").append(ending)), model);
    EXPECT_EQ(read_bytes(file(std::string("a").append(ending))),
              read_bytes(file(std::string("b").append(ending))))
        << ending;
  }
}

TEST_F(Formats, RowsThatAreNotFiniteAreLeftOut) {
  for (const ModelFormat& format : model_formats()) {
    GaussianModel model = model_for(format, 5, 1);
    model.gaussians.mean[1].y = NAN;
    model.gaussians.logit_opacity[3] = INFINITY;
    EXPECT_EQ(write_model(file(std::string("m").append(format.ending)), model), 3u) << format.name;
  }
}

// Rotations whose largest component is each of the four with either sign, two equal components, and
// lengths other than 1.
TEST_F(Formats, RotationsOfEverySignAndLargestComponentComeBack) {
  GaussianModel model = moderate_model(16 * 5, 0);
  std::size_t row = 0;
  for (int signs = 0; signs < 16; ++signs)
    for (int large = 0; large < 5; ++large) {
      float q[4];
      for (int i = 0; i < 4; ++i)
        q[i] = (signs >> i & 1 ? -1.0f : 1.0f) * (large == 4 ? 0.5f : i == large ? 3.0f : 0.7f * i);
      model.gaussians.rotation[row++] = {q[0], q[1], q[2], q[3]};
    }
  for (const Kind& kind : kKinds) {
    SCOPED_TRACE(kind.ending);
    GaussianModel unit = finite_model(model);
    expect_near(there_and_back(model, kind.ending, kind.options), unit, kind.tolerance);
  }
}

TEST_F(Formats, OpacitiesOfZeroAndOneStayFiniteAndNearThem) {
  GaussianModel model = moderate_model(3, 0);
  model.gaussians.logit_opacity[0] = -80;
  model.gaussians.logit_opacity[1] = 80;
  model.gaussians.logit_opacity[2] = 0;
  for (const Kind& kind : kKinds) {
    SCOPED_TRACE(kind.ending);
    const GaussianModel back = there_and_back(model, kind.ending, kind.options);
    EXPECT_EQ(finite_rows(back.gaussians, 0).size(), 3u);
    expect_near(back, model, kind.tolerance);
    for (const float logit : back.gaussians.logit_opacity)
      EXPECT_TRUE(std::abs(logit) < 0.01f || std::abs(logit) > 6.8f) << logit;
  }
}

TEST_F(Formats, ScalesBeyondAFormatBecomeTheNearestItHolds) {
  GaussianModel model = moderate_model(2, 0);
  model.gaussians.log_scale[0] = Vec3f(-60);
  model.gaussians.log_scale[1] = Vec3f(40);
  model.gaussians.mean[0] = Vec3f(0);
  model.gaussians.mean[1] = Vec3f(1);
  const auto scales = [&](const char* ending) {
    const GaussianModel back = there_and_back(model, ending);
    const bool is_turned = back.gaussians.mean[0].x > 0.5f;
    return Vec2f(back.gaussians.log_scale[is_turned].x, back.gaussians.log_scale[!is_turned].x);
  };
  EXPECT_EQ(scales(".compressed.ply"), Vec2f(-20, 20));
  EXPECT_EQ(scales(".spz"), Vec2f(-10, 5.9375f));
  EXPECT_NEAR(scales(".splat").x, -60, 1e-3);  // e^-60 is a float
}

TEST_F(Formats, ColorsBeyondAByteAreClampedNeverWrapped) {
  GaussianModel model = moderate_model(2, 1);
  for (const int sign : {-1, 1}) {
    model.gaussians.sh0[0] = model.gaussians.sh0[1] = Vec3f(sign * 50.0f);
    for (std::size_t i = 0; i < 2; ++i)
      for (Vec3f& c : model.gaussians.sh_rest[i].coefficient) c = Vec3f(sign * 50.0f);
    for (const char* ending : {".spz", ".splat"})
      EXPECT_GT(sign * there_and_back(model, ending).gaussians.sh0[0].x, 1.5f) << ending;
    EXPECT_GT(sign * there_and_back(model, ".spz").gaussians.sh_rest[0].coefficient[2].y,
              -0.99f * -sign * sign);
    EXPECT_GT(sign * there_and_back(model, ".compressed.ply").gaussians.sh_rest[0].coefficient[0].y,
              3.9f);
  }
}

TEST_F(Formats, AntialiasedModelsAreTaggedWhereThereIsATag) {
  for (const bool antialiased : {false, true})
    for (const char* ending :
         {".ply", ".compressed.ply", ".spz", ".sog", ".npz", ".glb", ".usda", ".usdc"}) {
      GaussianModel model = moderate_model(4, 0);
      model.antialiased = antialiased;
      EXPECT_EQ(there_and_back(model, ending).antialiased, antialiased) << ending;
    }
}

TEST_F(Formats, SpzTakesFewerFractionalBitsForFarPositions) {
  GaussianModel model = moderate_model(3, 0);
  model.gaussians.mean[2] = {-150'000, 70'000, 3};
  const GaussianModel back = there_and_back(model, ".spz");
  for (std::size_t i = 0; i < 3; ++i)
    EXPECT_LE(largest(back.gaussians.mean[i] - model.gaussians.mean[i]), 0.5f / 32) << i;
  model.gaussians.mean[2].x = 1e7f;
  EXPECT_THAT(error_of([&] { there_and_back(model, ".spz"); }),
              AllOf(HasSubstr("1e+07 world units"), HasSubstr("--recenter")));
}

TEST_F(Formats, FewerBitsOfShMakeSmallerFilesOfSpz) {
  const GaussianModel model = moderate_model(2000, 3);
  std::size_t least = 0;
  for (const int bits : {1, 4, 5, 8}) {
    write_model(file("a.spz"), model, {3, bits});
    EXPECT_GT(read_bytes(file("a.spz")).size(), least) << bits;
    least = read_bytes(file("a.spz")).size();
  }
}

// The format's own reader expects as many streams as there are arrays that are not empty.
TEST_F(Formats, SpzVersion4HasNoStreamForShOfDegreeZero) {
  for (const int degree : {0, 1}) {
    write_model(file("a.spz"), moderate_model(3, degree), {4});
    const std::string bytes = read_bytes(file("a.spz"));
    const std::size_t streams = degree == 0 ? 5 : 6;
    EXPECT_EQ(std::size_t(std::uint8_t(bytes[15])), streams);
    std::size_t end = kSpzHeaderBytes + sizeof(SpzStreamTable) + streams * sizeof(SpzStream);
    for (std::size_t s = 0; s < streams; ++s) {
      const auto stream = load_little<SpzStream>(bytes.data() + 32 + s * sizeof(SpzStream));
      EXPECT_GT(stream.raw, 0u) << s;
      end += stream.packed;
    }
    EXPECT_EQ(end, bytes.size());
  }
}

TEST_F(Formats, SpzVersion4WithAnEmptyStreamIsReadToo) {
  const GaussianModel model = moderate_model(3, 0);
  write_model(file("a.spz"), model, {4});
  std::string bytes = read_bytes(file("a.spz"));
  const std::string frame = zstd_frame("");
  std::string entry;
  append_little(entry, SpzStream{frame.size(), 0});
  bytes[15] = 6;
  bytes.insert(32 + 5 * sizeof(SpzStream), entry);
  write_bytes(file("b.spz"), bytes + frame);
  EXPECT_TRUE(same_bits(read_model(file("b.spz")).gaussians, read_model(file("a.spz")).gaussians));
}

TEST_F(Formats, StreamsOfSpzVersion4BeyondTheFileAreDamage) {
  write_model(file("a.spz"), moderate_model(3, 0), {4});
  const std::string bytes = read_bytes(file("a.spz"));
  // The number of streams, then the highest byte of the table's offset, of the first stream's length
  // and of the last one's
  for (const std::size_t at : {15, 19, 39, 103}) {
    std::string damaged = bytes;
    damaged[at] = '\x7f';
    write_bytes(file("b.spz"), damaged);
    EXPECT_THAT(error_of([&] { read_model(file("b.spz")); }),
                HasSubstr("its table of streams does not match the file"))
        << at;
  }
}

TEST_F(Formats, SogKeepsShThatFewKindsOfGaussiansShare) {
  GaussianModel model = moderate_model(2000, 3);
  for (std::size_t i = 0; i < 2000; ++i)
    model.gaussians.sh_rest[i] = model.gaussians.sh_rest[i % 20];
  const GaussianModel back = there_and_back(model, ".sog");
  std::size_t near = 0;
  for (std::size_t i = 0; i < 2000; ++i)
    for (std::size_t j = 0; j < 20; ++j) {
      bool is_near = true;
      // of numbers up to 0.7
      for (int k = 0; k < kShRestCount; ++k)
        is_near &= largest(back.gaussians.sh_rest[i].coefficient[k] -
                           model.gaussians.sh_rest[j].coefficient[k]) < 0.06f;
      if (is_near) {
        ++near;
        break;
      }
    }
  EXPECT_EQ(near, 2000u);
}

TEST_F(Formats, EndingsSayTheFormatInAnyCase) {
  EXPECT_EQ(find_format("a.compressed.ply")->name, "compressed.ply");
  EXPECT_EQ(find_format("dir.spz/A.PLY")->name, "ply");
  EXPECT_EQ(find_format("a.obj"), nullptr);
  EXPECT_THAT(error_of([] { format_to_write("a.ksplat"); }),
              HasSubstr("a.ksplat: gemsplat does not write .ksplat; it writes .ply, .glb"));
  EXPECT_THAT(error_of([] { format_to_write("a.csv"); }), HasSubstr("numpy.savetxt"));
  EXPECT_THAT(error_of([] { format_named("csv"); }), HasSubstr("numpy.savetxt"));
  EXPECT_THAT(error_of([] { format_to_write("a"); }), HasSubstr("files without an ending"));
  EXPECT_EQ(format_named("glb").ending, ".glb");
  EXPECT_THAT(error_of([] { format_named("obj"); }), HasSubstr("it has ply, glb"));
}

/// The files of a .sog in the folder that its pictures and meta.json may also lie in.
void unpack_sog(const std::filesystem::path& archive, const std::filesystem::path& folder) {
  const std::string bytes = read_bytes(archive);
  for (const auto& [name, content] : zip_entries(archive, bytes))
    write_bytes(folder / name, std::string(content));
}

TEST_F(Formats, AFolderOfSogFilesIsAModelAndNamesNoFileOfOthers) {
  write_model(file("a.sog"), moderate_model(50, 1));
  unpack_sog(file("a.sog"), file("sog"));
  for (const char* name : {"sog", "sog/meta.json"})
    EXPECT_TRUE(same_bits(read_model(file(name)).gaussians, read_model(file("a.sog")).gaussians))
        << name;
  EXPECT_EQ(find_format("a/META.json")->name, "sog folder");
  EXPECT_THAT(error_of([] { format_to_write("a/meta.json"); }), HasSubstr("choose .sog"));
  unpack_sog(file("a.sog"), file("other"));
  std::string meta = read_bytes(file("sog/meta.json"));
  meta.replace(meta.find("quats.webp"), 10, "../other/quats.webp");
  write_bytes(file("sog/meta.json"), meta);
  EXPECT_THAT(error_of([&] { read_model(file("sog")); }), HasSubstr("lacks ../other/quats.webp"));
}

TEST_F(Formats, AStreamedSogIsNamedWithARemedy) {
  write_bytes(file("lod/lod-meta.json"), "{}");
  for (const char* name : {"lod", "lod/lod-meta.json"})
    EXPECT_THAT(error_of([&] { read_model(file(name)); }),
                AllOf(HasSubstr("a streamed SOG"), HasSubstr("name a meta.json of its folders")));
  EXPECT_THAT(error_of([] { format_to_write("lod/lod-meta.json"); }),
              HasSubstr("a .rad has levels"));
}

TEST_F(Formats, FilesOfOtherProgramsAreNamedWithARemedy) {
  const auto error_reading = [&](const char* name, const std::string& bytes) {
    write_bytes(file(name), bytes);
    return error_of([&] { read_model(file(name)); });
  };
  EXPECT_THAT(error_reading("a.lcc", "any bytes"),
              AllOf(HasSubstr("an .lcc scene"), HasSubstr("convert it to .ply")));
  EXPECT_THAT(error_reading("a.ksplat", std::string("\0\1", 2)),
              AllOf(HasSubstr("a .ksplat file"), HasSubstr("splat-transform")));
  EXPECT_THAT(error_reading("a.csv", "x,y,z\n1,2,3\n"),
              AllOf(HasSubstr("a table"), HasSubstr("gemsplat.Model")));
  EXPECT_THAT(
      error_reading("point_cloud.ply", std::string("PK\x03\x04 a zip")),
      AllOf(HasSubstr("a zip file, as .sog and .npz files are"), HasSubstr("ends in .sog")));
  EXPECT_THAT(error_reading("a.model", "NGSP"), HasSubstr("ends in .spz"));
  EXPECT_THAT(error_reading("a.model", "some text"), HasSubstr("not a PLY file"));
  EXPECT_EQ(foreign_kind(file("none.lcc")), "");  // an Error says that it is missing
}

TEST_F(Formats, AWrongChecksumOfSpzIsDamage) {
  write_model(file("a.spz"), moderate_model(50, 1));
  std::string bytes = read_bytes(file("a.spz"));
  for (const std::size_t from_end : {8, 5}) {  // CRC-32, then the size
    std::string damaged = bytes;
    damaged[damaged.size() - from_end] ^= 1;
    write_bytes(file("b.spz"), damaged);
    EXPECT_THROW(read_model(file("b.spz")), Error) << from_end;
    write_bytes(file("b.spz"), bytes.substr(0, bytes.size() - from_end));
    EXPECT_THROW(read_model(file("b.spz")), Error) << from_end;
  }
}

TEST_F(Formats, TheChecksumOfZipIsItsOwn) {
  EXPECT_EQ(crc32_of("123456789"), 0xCBF43926u);  // the check value of CRC-32
  const auto archive = zip_of({{"a", "text"}, {"b.webp", ""}});
  EXPECT_EQ(zip_entries("", archive).at("a"), "text");
}

TEST_F(Formats, DeflatedEntriesOfAZipComeBackAndAreChecked) {
  std::string archive = zip_of({{"a", std::string(1000, 'a')}, {"b", ""}}, true);
  EXPECT_LT(archive.size(), 300u);
  const auto unpack = [&] { return unpacked("", "a", packed_entries("", archive).at("a")); };
  EXPECT_EQ(unpack(), std::string(1000, 'a'));
  EXPECT_THAT(error_of([&] { zip_entries("a.sog", archive); }), HasSubstr("is compressed"));
  constexpr std::size_t kCrcAt = 16;  // of the directory
  archive[archive.find("PK\x01\x02") + kCrcAt] ^= 1;
  EXPECT_THAT(error_of(unpack), HasSubstr("checksum of a"));
}

TEST_F(Formats, EntriesOfAZipThatShareTheirBytesAreRefused) {
  const std::string archive = zip_of({{"a", std::string(1000, 'a')}});
  constexpr std::size_t kEndBytes = 22, kEntriesAt = 10;  // of the last record
  const std::size_t directory = 30 + 1 + 1000, end = archive.size() - kEndBytes;
  std::string bomb = archive.substr(0, end);
  bomb += archive.substr(directory, end - directory);  // the same entry once more
  bomb += archive.substr(end);
  EXPECT_EQ(zip_entries("a.sog", bomb).size(), 1u);
  bomb[bomb.size() - kEndBytes + kEntriesAt] = 2;
  EXPECT_THAT(error_of([&] { zip_entries("a.sog", bomb); }), HasSubstr("not a complete zip"));
}

TEST_F(Formats, FilesOfAnotherKindAreRefusedWithAReason) {
  const std::string png = "\x89PNG\r\n\x1a\n and more than sixteen bytes";
  for (const char* ending : {".spz", ".sog", ".npz", ".compressed.ply", ".extreme_saving.zip"}) {
    write_bytes(file(std::string("x").append(ending)), png);
    EXPECT_THAT(error_of([&] { read_model(file(std::string("x").append(ending))); }),
                AllOf(HasSubstr("cannot read"), HasSubstr(std::string("x").append(ending))));
  }
  write_bytes(file("x.splat"), "33 bytes are not a multiple of 32.");
  EXPECT_THAT(error_of([&] { read_model(file("x.splat")); }),
              HasSubstr("not a multiple of the 32"));
}

TEST_F(Formats, CountsThatNoFileOfTheSizeHoldsAreRefusedBeforeMemoryIsAskedFor) {
  write_model(file("a.spz"), moderate_model(3, 0), {4});
  std::string bytes = read_bytes(file("a.spz"));
  bytes[11] = '\x7f';  // the highest byte of the count
  write_bytes(file("a.spz"), bytes);
  EXPECT_THAT(error_of([&] { read_model(file("a.spz")); }), HasSubstr("it promises 21307"));
}

}  // namespace
}  // namespace gs
