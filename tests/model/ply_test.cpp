// SPDX-License-Identifier: Apache-2.0
// PLY files of trained Gaussians: files that we write, files of other programs, and broken files.
#include "gs_model/formats/ply/ply.h"

#include <gmock/gmock.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <csignal>
#include <cstring>
#include <sstream>

#include "gs_core/bake_filter.h"
#include "gs_core/system/version.h"
#include "gs_model/formats/model_info.h"
#include "gs_model/formats/ply/mip_filter.h"
#include "tests/support/captured_log.h"
#include "tests/support/error_of.h"
#include "tests/support/random_model.h"
#include "tests/support/temp_folder.h"

namespace gs {
namespace {

using testing::AllOf;
using testing::HasSubstr;
using testing::Not;
using testing::StartsWith;

bool same_numbers(const Gaussians& a, const Gaussians& b) {
  bool same = true;
  for_each_array(
      [&](const char*, const auto& x, const auto& y) {
        same = same && x.size() == y.size() &&
               std::memcmp(x.data(), y.data(), x.size() * sizeof(x[0])) == 0;
      },
      a, b);
  return same;
}

std::vector<std::string> properties_of_degree(int sh_degree) {
  std::vector<std::string> names;
  for (const PlyColumn& column : gaussian_columns(Gaussians(), sh_degree)) {
    names.push_back(column.property);
  }
  return names;
}

/// Builds PLY files by hand, value by value, in any format.
struct PlyText {
  std::string format = "binary_little_endian", line_end = "\n";
  std::string header, body;

  void line(const std::string& text) { header += text + line_end; }
  void begin() {
    header.clear();
    body.clear();
    line("ply");
    line("format " + format + " 1.0");
  }
  template <class T>
  void value(T number) {
    if (format == "ascii") {
      std::ostringstream text;
      text.precision(9);
      text << +number << ' ';
      body += text.str();
      return;
    }
    char bytes[sizeof(T)];
    std::memcpy(bytes, &number, sizeof(T));
    if (format == "binary_big_endian") std::reverse(bytes, bytes + sizeof(T));
    body.append(bytes, sizeof(T));
  }
  void end_row() {
    if (format == "ascii") body += line_end;
  }
  std::string bytes() const { return header + "end_header" + line_end + body; }
};

/// All rows of `model` with the properties `names` in that order, of type T; a name that is not a
/// quantity gets 77.
template <class T = float>
void add_rows(PlyText& ply, const GaussianModel& model, const std::vector<std::string>& names) {
  const auto columns = gaussian_columns(model.gaussians, model.sh_degree);
  for (std::size_t row = 0; row < model.gaussians.count(); ++row) {
    for (const std::string& name : names) {
      const auto column = std::find_if(columns.begin(), columns.end(),
                                       [&](const PlyColumn& c) { return c.property == name; });
      ply.value(column == columns.end() ? T(77)
                                        : T(column->array[row * column->stride + column->offset]));
    }
    ply.end_row();
  }
}

template <class T = float>
std::string ply_of(const GaussianModel& model, const std::vector<std::string>& names,
                   PlyText ply = {}, const std::string& type = "float") {
  ply.begin();
  ply.line("element vertex " + std::to_string(model.gaussians.count()));
  for (const std::string& name : names) ply.line("property " + type + " " + name);
  add_rows<T>(ply, model, names);
  return ply.bytes();
}

class Ply : public testing::Test {
 protected:
  std::filesystem::path file() const { return folder_.path() / "point_cloud.ply"; }
  GaussianModel read(const std::string& bytes) const {
    write_bytes(file(), bytes);
    return read_gaussian_ply(file());
  }
  std::string error_reading(const std::string& bytes) const {
    return error_of([&] { read(bytes); });
  }
  void expect_reads(const std::string& bytes, const GaussianModel& model) const {
    const GaussianModel back = read(bytes);
    EXPECT_EQ(back.sh_degree, model.sh_degree);
    EXPECT_TRUE(same_numbers(back.gaussians, model.gaussians));
  }
  std::size_t file_count() const {
    std::size_t count = 0;
    for (const auto& entry : std::filesystem::recursive_directory_iterator(folder_.path())) {
      count += entry.is_regular_file();
    }
    return count;
  }

  TempFolder folder_;
};

// --- What we write

TEST_F(Ply, RoundTripIsBitExactAtEveryDegree) {
  for (int degree = 0; degree <= kMaxShDegree; ++degree) {
    GaussianModel model = random_model(1300, degree);  // more than two blocks of rows
    model.antialiased = degree % 2;
    EXPECT_EQ(write_gaussian_ply(file(), model), 0u);
    const GaussianModel back = read_gaussian_ply(file());
    EXPECT_EQ(back.sh_degree, degree);
    EXPECT_EQ(back.antialiased, model.antialiased);
    EXPECT_TRUE(same_numbers(back.gaussians, model.gaussians));
  }
}

TEST_F(Ply, HeaderIsTheReferenceTrainersAtDegreeOne) {
  GaussianModel model = random_model(2, 1);
  model.antialiased = true;
  write_gaussian_ply(file(), model);
  const std::string header =
      "ply\nformat binary_little_endian 1.0\ncomment gemsplat " + std::string(kVersion) +
      "\ncomment SplatRenderMode: mip\nelement vertex 2\n"
      "property float x\nproperty float y\nproperty float z\n"
      "property float nx\nproperty float ny\nproperty float nz\n"
      "property float f_dc_0\nproperty float f_dc_1\nproperty float f_dc_2\n"
      "property float f_rest_0\nproperty float f_rest_1\nproperty float f_rest_2\n"
      "property float f_rest_3\nproperty float f_rest_4\nproperty float f_rest_5\n"
      "property float f_rest_6\nproperty float f_rest_7\nproperty float f_rest_8\n"
      "property float opacity\nproperty float scale_0\nproperty float scale_1\nproperty float "
      "scale_2\n"
      "property float rot_0\nproperty float rot_1\nproperty float rot_2\nproperty float rot_3\n"
      "end_header\n";
  const std::string bytes = read_bytes(file());
  EXPECT_THAT(bytes, StartsWith(header));
  EXPECT_EQ(bytes.size(), header.size() + 2 * 26 * sizeof(float));
}

TEST_F(Ply, DegreeThreeHas62FloatsPerRow) {
  write_gaussian_ply(file(), random_model(3, 3));
  const std::string bytes = read_bytes(file());
  EXPECT_EQ(bytes.size() - (bytes.find("end_header\n") + 11), 3 * 248u);
}

TEST_F(Ply, FRestIsAllOfRedThenGreenThenBlue) {
  GaussianModel model = random_model(1, 3);
  for (int k = 0; k < kShRestCount; ++k) {
    model.gaussians.sh_rest[0].coefficient[k] = {100.0f + k, 200.0f + k, 300.0f + k};
  }
  write_gaussian_ply(file(), model);
  const std::string bytes = read_bytes(file());
  float row[62];
  std::memcpy(row, bytes.data() + bytes.size() - sizeof(row), sizeof(row));
  for (int k = 0; k < kShRestCount; ++k) {
    EXPECT_EQ(row[9 + k], 100.0f + k);
    EXPECT_EQ(row[9 + 15 + k], 200.0f + k);
    EXPECT_EQ(row[9 + 30 + k], 300.0f + k);
  }
}

TEST_F(Ply, SameModelGivesSameBytes) {
  const GaussianModel model = random_model(700, 2);
  write_gaussian_ply(folder_.path() / "a.ply", model);
  write_gaussian_ply(folder_.path() / "b.ply", model);
  EXPECT_EQ(read_bytes(folder_.path() / "a.ply"), read_bytes(folder_.path() / "b.ply"));
}

TEST_F(Ply, WritingWhatWasReadGivesSameBytes) {
  GaussianModel model = random_model(700, 1);
  for (Quatf& q : model.gaussians.rotation) q = {3 * q.w, 3 * q.x, 3 * q.y, 3 * q.z};
  write_gaussian_ply(folder_.path() / "a.ply", model);
  write_gaussian_ply(folder_.path() / "b.ply", read_gaussian_ply(folder_.path() / "a.ply"));
  EXPECT_EQ(read_bytes(folder_.path() / "a.ply"), read_bytes(folder_.path() / "b.ply"));
}

TEST_F(Ply, RotationsAreWrittenWithLengthOne) {
  GaussianModel model = random_model(3, 0);
  model.gaussians.rotation[0] = {2, 0, 0, 0};
  model.gaussians.rotation[1] = {0, 0, 0, 0};
  model.gaussians.rotation[2] = {0, 3e-30f, 4e-30f, 0};
  write_gaussian_ply(file(), model);
  const GaussianModel back = read_gaussian_ply(file());
  EXPECT_EQ(back.gaussians.rotation[0].w, 1);
  EXPECT_EQ(back.gaussians.rotation[1].w, 1);
  EXPECT_FLOAT_EQ(back.gaussians.rotation[2].x, 0.6f);
  EXPECT_FLOAT_EQ(back.gaussians.rotation[2].y, 0.8f);
}

TEST_F(Ply, RowsWithNanOrInfinityAreLeftOutAndCounted) {
  GaussianModel model = random_model(5, 1);
  model.gaussians.mean[0].y = NAN;
  model.gaussians.logit_opacity[2] = INFINITY;
  model.gaussians.sh_rest[3].coefficient[2].z = -INFINITY;
  model.gaussians.sh_rest[4].coefficient[3].z = NAN;  // beyond the degree: not written
  EXPECT_EQ(write_gaussian_ply(file(), model), 3u);
  const GaussianModel back = read_gaussian_ply(file());
  ASSERT_EQ(back.gaussians.count(), 2u);
  EXPECT_EQ(back.gaussians.mean[0], model.gaussians.mean[1]);
  EXPECT_EQ(back.gaussians.mean[1], model.gaussians.mean[4]);
}

TEST_F(Ply, EmptyModelIsAFileWithoutRows) {
  write_gaussian_ply(file(), random_model(0, 3));
  EXPECT_EQ(read_gaussian_ply(file()).gaussians.count(), 0u);
}

TEST_F(Ply, PointsHaveNormalsAndByteColors) {
  write_point_ply(file(), {{{1, 2, 3}, {4, 5, 255}}, {{-1, 0, 0}, {0, 0, 9}}});
  const std::string bytes = read_bytes(file());
  EXPECT_THAT(bytes,
              HasSubstr("element vertex 2\nproperty float x\nproperty float y\nproperty float z\n"
                        "property float nx\nproperty float ny\nproperty float nz\n"
                        "property uchar red\nproperty uchar green\nproperty uchar blue\n"
                        "end_header\n"));
  const std::string rows = bytes.substr(bytes.find("end_header\n") + 11);
  ASSERT_EQ(rows.size(), 2 * 27u);
  float position[6];
  std::memcpy(position, rows.data(), sizeof(position));
  EXPECT_THAT(position, testing::ElementsAre(1, 2, 3, 0, 0, 0));
  EXPECT_EQ(rows.substr(24, 3), "\x04\x05\xff");
}

// --- Where it is written

TEST_F(Ply, FoldersAboveAreCreatedAndNothingElseIsLeft) {
  write_gaussian_ply(folder_.path() / "point_cloud/iteration_7/point_cloud.ply",
                     random_model(4, 0));
  EXPECT_TRUE(std::filesystem::exists(folder_.path() / "point_cloud/iteration_7/point_cloud.ply"));
  EXPECT_EQ(file_count(), 1u);
}

TEST_F(Ply, UnwritablePlaceIsNamed) {
  write_bytes(folder_.path() / "stone", "a file, no folder");
  const auto path = folder_.path() / "stone" / "out.ply";
  EXPECT_THAT(error_of([&] { write_gaussian_ply(path, random_model(1, 0)); }),
              AllOf(StartsWith("cannot write " + path.string()), HasSubstr("choose another name")));
}

TEST_F(Ply, FolderWithoutPermissionIsNamed) {
  if (::geteuid() == 0) GTEST_SKIP() << "root may write everywhere";
  std::filesystem::permissions(folder_.path(), std::filesystem::perms(0555));
  EXPECT_THAT(error_of([&] { write_gaussian_ply(file(), random_model(1, 0)); }),
              AllOf(HasSubstr(file().string()), HasSubstr("that you may change")));
  std::filesystem::permissions(folder_.path(), std::filesystem::perms(0755));
}

TEST_F(Ply, FailureHalfwayLeavesTheOlderFileAndNoOther) {
  write_bytes(file(), "older");
  std::signal(SIGXFSZ, SIG_IGN);
  rlimit before{};
  getrlimit(RLIMIT_FSIZE, &before);
  const rlimit small{100'000, before.rlim_max};
  setrlimit(RLIMIT_FSIZE, &small);
  const std::string message = error_of([&] { write_gaussian_ply(file(), random_model(2000, 3)); });
  setrlimit(RLIMIT_FSIZE, &before);
  EXPECT_THAT(message, AllOf(HasSubstr(file().string()), HasSubstr("free some space")));
  EXPECT_EQ(read_bytes(file()), "older");
  EXPECT_EQ(file_count(), 1u);
}

TEST_F(Ply, LinksStayAndPipesAreNotReplaced) {
  write_bytes(folder_.path() / "real/target.ply", "older");
  std::filesystem::create_symlink("real/target.ply", file());
  write_gaussian_ply(file(), random_model(2, 0));
  EXPECT_TRUE(std::filesystem::is_symlink(file()));
  EXPECT_EQ(read_gaussian_ply(folder_.path() / "real/target.ply").gaussians.count(), 2u);
  const auto pipe = folder_.path() / "pipe";
  ASSERT_EQ(::mkfifo(pipe.c_str(), 0600), 0);
  EXPECT_THAT(error_of([&] { write_gaussian_ply(pipe, random_model(2, 0)); }),
              HasSubstr("cannot write " + pipe.string()));
  EXPECT_TRUE(std::filesystem::is_fifo(pipe));
}

TEST_F(Ply, FolderInThePlaceOfTheFileLeavesNoOtherFile) {
  std::filesystem::create_directories(file() / "inside");
  EXPECT_THAT(error_of([&] { write_gaussian_ply(file(), random_model(1, 0)); }),
              HasSubstr("cannot write"));
  EXPECT_EQ(file_count(), 0u);
}

// --- What others write

TEST_F(Ply, ReadsGsplatsOrderWithoutNormals) {
  const GaussianModel model = random_model(9, 3);
  expect_reads(ply_of(model, properties_of_degree(3)), model);
}

TEST_F(Ply, ReadsBrushsOrder) {
  const GaussianModel model = random_model(9, 2);
  std::vector<std::string> names{"x",       "y",     "z",     "scale_0", "scale_1", "scale_2",
                                 "opacity", "rot_0", "rot_1", "rot_2",   "rot_3"};
  for (const std::string& name : properties_of_degree(2)) {
    if (name.starts_with("f_")) names.push_back(name);
  }
  expect_reads(ply_of(model, names), model);
}

TEST_F(Ply, ReadsAnyOrderWithUnknownProperties) {
  const GaussianModel model = random_model(9, 1);
  std::vector<std::string> names = properties_of_degree(1);
  names.insert(names.begin() + 5, "segment");
  names.push_back("nz");
  std::reverse(names.begin(), names.end());
  expect_reads(ply_of(model, names), model);
}

TEST_F(Ply, ReadsEveryFormatAndLineEnd) {
  const GaussianModel model = random_model(9, 1);
  for (const char* format : {"binary_little_endian", "binary_big_endian", "ascii"}) {
    for (const char* line_end : {"\n", "\r\n"}) {
      SCOPED_TRACE(std::string(format) + (line_end[0] == '\r' ? " CRLF" : " LF"));
      PlyText ply;
      ply.format = format;
      ply.line_end = line_end;
      expect_reads(ply_of(model, properties_of_degree(1), ply), model);
    }
  }
}

TEST_F(Ply, ReadsDoubles) {
  const GaussianModel model = random_model(9, 1);
  expect_reads(ply_of<double>(model, properties_of_degree(1), {}, "double"), model);
  PlyText big;
  big.format = "binary_big_endian";
  expect_reads(ply_of<double>(model, properties_of_degree(1), big, "float64"), model);
}

TEST_F(Ply, ReadsIntegers) {
  GaussianModel model = random_model(3, 0);
  const auto columns = gaussian_columns(model.gaussians, 0);
  for (std::size_t c = 0; c < columns.size(); ++c) {
    for (std::size_t i = 0; i < 3; ++i) {
      columns[c].array[i * columns[c].stride + columns[c].offset] = float(c + i);
    }
  }
  const auto names = properties_of_degree(0);
  expect_reads(ply_of<std::int8_t>(model, names, {}, "char"), model);
  expect_reads(ply_of<std::uint8_t>(model, names, {}, "uint8"), model);
  expect_reads(ply_of<std::int16_t>(model, names, {}, "short"), model);
  expect_reads(ply_of<std::uint16_t>(model, names, {}, "ushort"), model);
  expect_reads(ply_of<std::int32_t>(model, names, {}, "int"), model);
  expect_reads(ply_of<std::uint32_t>(model, names, {}, "uint32"), model);
}

TEST_F(Ply, PassesOverOtherElementsAndLists) {
  const GaussianModel model = random_model(4, 1);
  const auto names = properties_of_degree(1);
  for (const char* format : {"binary_little_endian", "binary_big_endian", "ascii"}) {
    SCOPED_TRACE(format);
    PlyText ply;
    ply.format = format;
    ply.begin();
    ply.line("element nothing 1000000000000000000");
    ply.line("element fixed 2");
    ply.line("property double a");
    ply.line("property uchar b");
    ply.line("element strips 2");
    ply.line("property list uchar int indices");
    ply.line("property float after");
    ply.line("element vertex 4");
    for (std::size_t i = 0; i < names.size(); ++i) {
      if (i == 3) ply.line("property list int short seen_by");
      ply.line("property float " + names[i]);
    }
    ply.line("element tail 1");
    ply.line("property int t");
    for (int row = 0; row < 2; ++row) {
      ply.value(1.5);
      ply.value(std::uint8_t(3));
      ply.end_row();
    }
    for (const int length : {3, 0}) {
      ply.value(std::uint8_t(length));
      for (int i = 0; i < length; ++i) ply.value(std::int32_t(i));
      ply.value(0.5f);
      ply.end_row();
    }
    const auto columns = gaussian_columns(model.gaussians, 1);
    for (int row = 0; row < 4; ++row) {
      for (std::size_t c = 0; c < columns.size(); ++c) {
        if (c == 3) {
          ply.value(std::int32_t(row));
          for (int i = 0; i < row; ++i) ply.value(std::int16_t(-i));
        }
        ply.value(columns[c].array[row * columns[c].stride + columns[c].offset]);
      }
      ply.end_row();
    }
    ply.value(std::int32_t(9));
    ply.end_row();
    expect_reads(ply.bytes(), model);
  }
}

TEST_F(Ply, ReadsAsciiNumbersOfEveryKind) {
  std::string text = "ply\nformat ascii 1.0\nobj_info by hand\nelement vertex 1\n";
  for (const std::string& name : properties_of_degree(0)) text += "property float " + name + "\n";
  const auto model = read(
      text + "end_header\n\n  1 +2.5\t-3e-2 nan -nan(ind) inf -Inf 1e-60 1e60 .5 1. 0 0 0 \r\n");
  const Gaussians& g = model.gaussians;
  EXPECT_EQ(g.mean[0], Vec3f(1, 2.5f, -0.03f));
  EXPECT_TRUE(std::isnan(g.sh0[0].x) && std::isnan(g.sh0[0].y));
  EXPECT_EQ(g.sh0[0].z, INFINITY);
  EXPECT_EQ(g.logit_opacity[0], -INFINITY);
  EXPECT_EQ(g.log_scale[0], Vec3f(0, INFINITY, 0.5f));
  EXPECT_EQ(g.rotation[0].w, 1);
}

TEST_F(Ply, CommentsSayWhetherItIsAntialiased) {
  const std::string bytes = ply_of(random_model(1, 0), properties_of_degree(0));
  const auto antialiased = [&](const std::string& comment) {
    return read("ply\ncomment " + comment + bytes.substr(3)).antialiased;
  };
  EXPECT_TRUE(antialiased("SplatRenderMode: mip"));
  EXPECT_TRUE(antialiased("antialiased 1"));
  EXPECT_TRUE(antialiased("postshot.anti_aliasing=1"));
  EXPECT_FALSE(antialiased("postshot.anti_aliasing=0"));
  EXPECT_FALSE(antialiased("SplatRenderMode: default"));
  EXPECT_FALSE(antialiased("antialiased 0"));
  EXPECT_FALSE(antialiased(""));
  EXPECT_FALSE(antialiased("antialiased"));
}

// add_rows() writes 77 for each name that it does not know: here this is the filter's standard
// deviation.
TEST_F(Ply, AMipSplattingFilterIsBakedIntoScalesAndOpacities) {
  const GaussianModel model = random_model(3, 1);
  std::vector<std::string> names = properties_of_degree(1);
  names.push_back("filter_3D");
  const GaussianModel back = read(ply_of(model, names));
  EXPECT_TRUE(is_ply_with_filter_3d(file()));
  EXPECT_TRUE(back.antialiased);
  for (std::size_t i = 0; i < 3; ++i) {
    double share = 1;  // of the opacity
    for (int axis = 0; axis < 3; ++axis) {
      const double s2 = std::exp(2.0 * model.gaussians.log_scale[i][axis]), f2 = 77.0 * 77.0;
      EXPECT_NEAR(back.gaussians.log_scale[i][axis], 0.5 * std::log(s2 + f2), 1e-6);
      share *= std::sqrt(s2 / (s2 + f2));
    }
    const double opacity = share / (1 + std::exp(-double(model.gaussians.logit_opacity[i])));
    EXPECT_NEAR(back.gaussians.logit_opacity[i], std::log(opacity / (1 - opacity)), 1e-4);
    EXPECT_EQ(back.gaussians.mean[i], model.gaussians.mean[i]);
  }
  write_gaussian_ply(file(), back);
  EXPECT_FALSE(is_ply_with_filter_3d(file()));  // the filter is in the numbers now
  const std::string plain = ply_of(model, names);
  EXPECT_FALSE(read("ply\ncomment SplatRenderMode: default" + plain.substr(3)).antialiased);
}

void bake(Gaussians& gaussians, const std::vector<float>& filter) {
  gaussians.has_filter = true;
  gaussians.filter_scale.upload(filter);
  bake_filter(gaussians);
  EXPECT_FALSE(gaussians.has_filter);
}

TEST_F(Ply, AFilterOfZeroChangesNothingAndATinyGaussianStaysFinite) {
  GaussianModel model = random_model(3, 0);
  bake(model.gaussians, {0, 0, 0});
  EXPECT_TRUE(same_numbers(model.gaussians, random_model(3, 0).gaussians));
  model.gaussians.logit_opacity[0] = 60;  // 1 in float and in double
  model.gaussians.log_scale[1] = Vec3f(-300);
  bake(model.gaussians, {1e-6f, 1, 1});
  EXPECT_GT(model.gaussians.logit_opacity[0], 20);
  EXPECT_TRUE(std::isfinite(model.gaussians.logit_opacity[0]));
  EXPECT_EQ(model.gaussians.log_scale[1], Vec3f(0));
  EXPECT_EQ(model.gaussians.logit_opacity[1], -80);
}

TEST_F(Ply, ARawModelKeepsItsFilterBesideScalesAndOpacities) {
  GaussianModel model = random_model(5, 2);
  model.antialiased = true;
  Gaussians& gaussians = model.gaussians;
  gaussians.has_filter = true;
  gaussians.filter_scale.upload({0.1f, 0.2f, 0.3f, 1e-5f, 7});
  write_gaussian_ply(file(), model);
  EXPECT_TRUE(is_ply_with_filter_3d(file()));
  const GaussianModel raw = read_raw_gaussian_ply(file());
  ASSERT_TRUE(raw.gaussians.has_filter);
  EXPECT_TRUE(raw.antialiased);
  EXPECT_EQ(raw.gaussians.filter_scale.download(), gaussians.filter_scale.download());
  EXPECT_EQ(raw.gaussians.log_scale.download(), gaussians.log_scale.download());
  EXPECT_EQ(raw.gaussians.logit_opacity.download(), gaussians.logit_opacity.download());

  const GaussianModel baked = read_gaussian_ply(file());
  EXPECT_FALSE(baked.gaussians.has_filter);
  for (std::size_t i = 0; i < 5; ++i)
    for (int axis = 0; axis < 3; ++axis)
      EXPECT_GE(baked.gaussians.log_scale[i][axis], std::log(gaussians.filter_scale[i]) - 1e-6f);
}

TEST_F(Ply, OfColorsThatChangeSaysThatTheyAreNotDrawn) {
  Gaussians moving;
  moving.has_time = true;
  std::string header = "ply\nformat binary_little_endian 1.0\nelement vertex 0\n";
  for (const PlyColumn& column : gaussian_columns(moving, 0))
    header += "property float " + column.property + "\n";
  for (const char* name : {"f_dc_slope_0", "f_dc_slope_1", "f_dc_slope_2"})
    header += std::string("property float ") + name + "\n";
  const CapturedLog log;
  EXPECT_TRUE(read(header + "end_header\n").gaussians.has_time);
  EXPECT_THAT(log.text(), HasSubstr("colors that change in time (f_dc_slope_0)"));
}

TEST_F(Ply, ACommentSaysWhetherItIsOurs) {
  write_gaussian_ply(file(), random_model(3, 1));
  EXPECT_TRUE(read_gaussian_ply(file()).is_ours);
  EXPECT_FALSE(read(ply_of(random_model(3, 1), properties_of_degree(1))).is_ours);
}

TEST_F(Ply, ReadsALargeStrideAcrossBlocks) {
  const GaussianModel model = random_model(700, 0);
  std::vector<std::string> names = properties_of_degree(0);
  for (int i = 0; i < 5000; ++i) names.insert(names.begin() + 4, "extra_" + std::to_string(i));
  expect_reads(ply_of(model, names), model);
}

// --- What is broken

TEST_F(Ply, TruncationAnywhereIsAnError) {
  for (const char* format : {"binary_little_endian", "ascii"}) {
    PlyText ply;
    ply.format = format;
    const std::string bytes = ply_of(random_model(2, 0), properties_of_degree(0), ply);
    for (std::size_t length = 0; length < bytes.size(); ++length) {
      SCOPED_TRACE(std::string(format) + " " + std::to_string(length));
      EXPECT_THAT(error_reading(bytes.substr(0, length)),
                  AllOf(StartsWith("cannot read " + file().string()), Not(HasSubstr("\n"))));
    }
  }
}

TEST_F(Ply, TruncationInsideListsIsAnError) {
  PlyText ply;
  ply.begin();
  ply.line("element strips 2");
  ply.line("property list int double indices");
  ply.line("element vertex 1");
  for (const std::string& name : properties_of_degree(0)) ply.line("property float " + name);
  for (int row = 0; row < 2; ++row) {
    ply.value(std::int32_t(2));
    ply.value(1.0);
    ply.value(2.0);
  }
  add_rows(ply, random_model(1, 0), properties_of_degree(0));
  const std::string bytes = ply.bytes();
  EXPECT_NO_THROW(read(bytes));
  for (std::size_t length = bytes.size() - ply.body.size(); length < bytes.size(); ++length) {
    EXPECT_THAT(error_reading(bytes.substr(0, length)),
                StartsWith("cannot read " + file().string()));
  }
  for (const char last : {'\xff', '\x7f'}) {  // of the length: it is negative, or beyond the file
    ply.body[3] = last;
    EXPECT_THAT(error_reading(ply.bytes()), HasSubstr("impossible length"));
  }
}

TEST_F(Ply, PromisesAreCheckedAgainstTheSizeOfTheFile) {
  for (const char* format : {"binary_little_endian", "ascii"}) {
    PlyText ply;
    ply.format = format;
    std::string bytes = ply_of(random_model(2, 3), properties_of_degree(3), ply);
    bytes.replace(bytes.find("vertex 2"), 8, "vertex 1000000000000000000");
    EXPECT_THAT(error_reading(bytes), AllOf(HasSubstr("promises 1000000000000000000 rows"),
                                            HasSubstr("only "), HasSubstr("cut short")));
    bytes.replace(bytes.find("vertex 1"), 26, "vertex 99999999999999999999999");
    EXPECT_THAT(error_reading(bytes), HasSubstr("is not a count of rows"));
    bytes.replace(bytes.find("vertex 9"), 30, "vertex -1");
    EXPECT_THAT(error_reading(bytes), HasSubstr("is not a count of rows"));
  }
}

TEST_F(Ply, EveryMissingPropertyIsNamed) {
  const GaussianModel model = random_model(2, 0);
  for (const std::string& missing : properties_of_degree(0)) {
    auto names = properties_of_degree(0);
    std::erase(names, missing);
    EXPECT_THAT(error_reading(ply_of(model, names)), HasSubstr(missing));
  }
  auto names = properties_of_degree(0);
  for (const char* missing : {"y", "opacity", "rot_2"}) std::erase(names, missing);
  EXPECT_THAT(error_reading(ply_of(model, names)), HasSubstr("lacks y, opacity, rot_2;"));
}

TEST_F(Ply, FRestThatFitsNoDegreeIsAnError) {
  auto names = properties_of_degree(1);
  std::erase(names, "f_rest_4");
  EXPECT_THAT(error_reading(ply_of(random_model(2, 1), names)),
              HasSubstr("8 f_rest_ properties belong to no SH degree"));
  names.push_back("f_rest_9");
  EXPECT_THAT(error_reading(ply_of(random_model(2, 1), names)), HasSubstr("lacks f_rest_4;"));
  names.push_back("f_rest_4");
  EXPECT_THAT(error_reading(ply_of(random_model(2, 1), names)),
              HasSubstr("10 f_rest_ properties belong to no SH degree"));
}

TEST_F(Ply, DegreeFourSaysWhatToDo) {
  auto names = properties_of_degree(3);
  for (int i = 45; i < 72; ++i) names.push_back("f_rest_" + std::to_string(i));
  EXPECT_THAT(error_reading(ply_of(random_model(2, 3), names)),
              AllOf(HasSubstr("SH degree 4 is not supported"), HasSubstr("degree 3 or less")));
}

TEST_F(Ply, OtherKindsOfFileAreNamed) {
  write_point_ply(file(), {{{1, 2, 3}, {4, 5, 6}}});
  const std::string points = read_bytes(file());
  EXPECT_THAT(error_reading(points), HasSubstr("this is a point cloud, not trained Gaussians"));
  std::string mesh = points;
  mesh.insert(mesh.find("end_header"), "element face 1\nproperty list uchar int vertex_indices\n");
  mesh += std::string("\x03\1\0\0\0\1\0\0\0\1\0\0\0", 13);
  EXPECT_THAT(error_reading(mesh), HasSubstr("this is a mesh"));
  EXPECT_THAT(
      error_reading("ply\nformat binary_little_endian 1.0\nelement chunk 1\nproperty float min_x\n"
                    "element vertex 1\nproperty uint packed_position\nend_header\n01234567"),
      HasSubstr("as a compressed PLY it lacks min_y"));
  EXPECT_THAT(error_reading("\x89PNG\r\n\x1a\n"), HasSubstr("this is not a PLY file"));
  EXPECT_THAT(error_reading("plywood\n"), HasSubstr("this is not a PLY file"));
  EXPECT_THAT(error_reading(""), HasSubstr("the file is empty"));
  EXPECT_THAT(error_reading("ply\nformat ascii 1.0\nelement dog 0\nend_header\n"),
              HasSubstr("no element \"vertex\""));
}

TEST_F(Ply, MissingFilesAndFoldersAreNamed) {
  const auto nowhere = folder_.path() / "nowhere.ply";
  EXPECT_THAT(error_of([&] { read_gaussian_ply(nowhere); }),
              AllOf(HasSubstr(nowhere.string()), HasSubstr("no such file")));
  EXPECT_THAT(error_of([&] { read_gaussian_ply(folder_.path()); }), HasSubstr("this is a folder"));
  EXPECT_THAT(error_of([&] { read_gaussian_ply("/dev/zero"); }), HasSubstr("not a regular file"));
}

TEST_F(Ply, DamagedHeadersNameTheLine) {
  const auto error = [&](const std::string& lines) {
    return error_reading("ply\n" + lines + "\nend_header\n");
  };
  EXPECT_THAT(error("format ascii 2.0"), HasSubstr("in line 2"));
  EXPECT_THAT(error("format text 1.0"), HasSubstr("in line 2"));
  EXPECT_THAT(error("comment no format"), HasSubstr("no format line"));
  EXPECT_THAT(error("format ascii 1.0\nproperty float x"), HasSubstr("before the first element"));
  EXPECT_THAT(error("format ascii 1.0\nelement vertex"), HasSubstr("in line 3"));
  EXPECT_THAT(error("format ascii 1.0\nelement vertex 1\nproperty half x"), HasSubstr("\"half\""));
  EXPECT_THAT(error("format ascii 1.0\nelement vertex 1\nproperty list float int x"),
              HasSubstr("not an integer"));
  EXPECT_THAT(error("format ascii 1.0\nelement vertex 1\nproperty float x\nproperty int x"),
              HasSubstr("x occurs twice, in line 5"));
  EXPECT_THAT(error("format ascii 1.0\nnonsense"), HasSubstr("\"nonsense\""));
  EXPECT_THAT(error_reading("ply\n" + std::string(3 << 20, 'x')), HasSubstr("no end"));
}

TEST_F(Ply, AsciiThatDoesNotParseNamesTheLine) {
  PlyText ply;
  ply.format = "ascii";
  const std::string good = ply_of(random_model(3, 0), properties_of_degree(0), ply);
  const std::size_t second = good.find('\n', good.find("end_header\n") + 11) + 1;
  const std::size_t line = std::size_t(std::count(good.begin(), good.begin() + second, '\n')) + 1;
  const auto error = [&](const std::string& inserted) {
    return error_reading(std::string(good).insert(second, inserted));
  };
  const std::string place = "line " + std::to_string(line) + " ";
  EXPECT_THAT(error("1.2.3 "), AllOf(HasSubstr(place), HasSubstr("\"1.2.3\" as \"x\"")));
  EXPECT_THAT(error("0x10 "), HasSubstr("is not a number"));
  EXPECT_THAT(error("5 "), AllOf(HasSubstr(place), HasSubstr("more than 14 values")));
  EXPECT_THAT(error("5\n"), AllOf(HasSubstr(place), HasSubstr("no value for \"y\"")));
}

TEST_F(Ply, ALineWithoutEndIsAnError) {
  PlyText ply;
  ply.format = "ascii";
  const std::string good = ply_of(random_model(1, 0), properties_of_degree(0), ply);
  const std::size_t body = good.find("end_header\n") + 11;
  EXPECT_THAT(error_reading(good.substr(0, body) + std::string(std::size_t(3) << 20, '1')),
              HasSubstr("cut short"));
}

TEST(GaussianModel, HostCopyKeepsWhetherItWasTrainedAntialiased) {
  EXPECT_TRUE(host_copy(Gaussians(1, host_memory()), 3, true).antialiased);
  EXPECT_FALSE(host_copy(Gaussians(1, host_memory()), 3, false).antialiased);
  EXPECT_TRUE(host_copy(Gaussians(1, host_memory()), 3, false).is_ours);
}

}  // namespace
}  // namespace gs
