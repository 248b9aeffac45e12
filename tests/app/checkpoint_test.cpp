// SPDX-License-Identifier: Apache-2.0
// Checkpoint files that are complete, cut short, damaged, on a full disk, or interrupted by a kill
// at every point of writing.
#include "gs_app/checkpoints/checkpoint_file.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#include <cstring>
#include <limits>

#include "gs_app/checkpoints/checkpoint_folder.h"
#include "gs_app/session/last_checkpoint.h"
#include "gs_core/error.h"
#include "gs_core/system/files/access.h"
#include "gs_core/system/files/atomic_file.h"
#include "gs_core/system/files/checked_file.h"
#include "tests/support/captured_log.h"
#include "tests/support/counted_memory.h"
#include "tests/support/error_of.h"
#include "tests/support/models.h"
#include "tests/support/small_scene.h"
#include "tests/support/temp_folder.h"

namespace gs {
namespace {

namespace fs = std::filesystem;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

constexpr FileKind kKind{"gsckpt\r\n", 2, 2};  // as it is written

/// A model in which all numbers differ, in the state after some step.
TrainingState telling_state(std::size_t gaussians, int step, bool has_time = false,
                            MomentStorage storage = MomentStorage::floats) {
  TrainingState state;
  state.model.store_moments_as(storage);
  state.model.gaussians.has_time = has_time;
  state.model.gaussians.resize(gaussians);
  clear_history(state.model);
  float next = float(step);
  const auto fill = [&](const char*, auto& array) {
    for (float& number : numbers_of(array)) number = next += 0.37f;
  };
  for_each_array(fill, state.model.gaussians);
  number_moments(state.model, std::uint32_t(step) + 1000, 100);
  fill("", state.model.statistics.visits);
  fill("", state.model.statistics.gradient_norm);
  state.model.adam_steps = step + 5;
  state.progress = {step, 2, 0.1234567890123, 77.7, 1234567, {0, 1, 2}, {2, 0, 1}};
  return state;
}

void tell(float& number, float& next) { number = next += 0.37f; }
void tell(FloatMoments& moments, float& next) {
  tell(moments.first, next);
  tell(moments.second, next);
}

/// A photometric model and poses, in whose arrays all numbers differ.
void add_photos(TrainingModel& model) {
  float next = 0.25f;
  const auto tell_all = [&](const char*, auto& array) {
    for (auto& number : array) tell(number, next);
  };
  model.photometric.begin(3, 3);
  model.photometric.adam_steps = 9;
  model.photometric.is_solved = true;
  for_each_photometric_array(tell_all, model.photometric);
  model.poses.begin(3, kPoseNumbers);
  model.poses.adam_steps = 7;
  for_each_pose_array(tell_all, model.poses);
}

/// Three training views and a test view, one with a name that is not UTF-8.
SceneRecord telling_scene() {
  SceneRecord scene;
  scene.extent = 1.7f;
  scene.world_offset = {500000.25, 1e-9, -3};
  for (int k = 0; k < 4; ++k) {
    ViewRecord view{"view \xff " + std::to_string(k), k == 3, orbit_camera(0.3f * float(k)),
                    Vec3f(1, 0.9f, float(k))};
    view.camera.cx += float(k);
    scene.views.push_back(view);
  }
  return scene;
}

Config telling_config() {
  Config config;
  config.dataset.source = "a \"folder\"\nwith # everything\\";
  config.optimizer.sh0_lr = 0.1f / 3;
  config.train.seed = 9007199254740991;
  config.train.save_steps = {5, 6};
  config.density.max_gaussians = 3000000000;
  return config;
}

std::vector<int> steps_in(const fs::path& folder) {
  std::vector<int> steps;
  for (const CheckpointPath& checkpoint : checkpoints_in(folder)) steps.push_back(checkpoint.step);
  return steps;
}

class Checkpoints : public ::testing::Test {
 protected:
  CheckpointFolder folder(CheckpointFolder::FreeSpace space = free_space) {
    return CheckpointFolder(path(), telling_config(), telling_scene(), std::move(space));
  }
  bool save(CheckpointFolder&& folder, int step, std::size_t gaussians = 7) {
    const TrainingState state = telling_state(gaussians, step);
    return folder.save(state.progress, state.model);
  }
  fs::path path() const { return folder_.path() / "checkpoints"; }
  fs::path file(int step) const { return path() / ("step_" + std::to_string(step) + ".ckpt"); }

 private:
  TempFolder folder_;
};

TEST_F(Checkpoints, ComeBackBitForBit) {
  for (const std::size_t gaussians : {0, 1, 1000}) {
    ASSERT_TRUE(save(folder(), 12, gaussians));
    const Checkpoint read = read_checkpoint(file(12));
    const TrainingState expected = telling_state(gaussians, 12);
    EXPECT_TRUE(same_bits(read.state.model, expected.model));
    EXPECT_TRUE(same_bits(read.state.model.statistics.visits, expected.model.statistics.visits));
    EXPECT_TRUE(same_bits(read.state.model.statistics.gradient_norm,
                          expected.model.statistics.gradient_norm));
    const RunProgress &a = read.state.progress, &b = expected.progress;
    EXPECT_EQ(a.step, b.step);
    EXPECT_EQ(a.sh_degree, b.sh_degree);
    EXPECT_EQ(a.loss, b.loss);
    EXPECT_EQ(a.train_seconds, b.train_seconds);
    EXPECT_EQ(a.growth_cap, b.growth_cap);
    EXPECT_EQ(a.strikes, b.strikes);
    EXPECT_EQ(a.view_order, b.view_order);
    EXPECT_EQ(to_toml(read.config), to_toml(telling_config()));
  }
}

TEST_F(Checkpoints, OfGaussiansInSpaceAndTimeComeBackWithTheTimesOfTheViews) {
  const TrainingState expected = telling_state(100, 12, true);
  SceneRecord scene = telling_scene();
  for (std::size_t i = 0; i < scene.views.size(); ++i) scene.views[i].camera.time = 0.1f * float(i);
  fs::create_directories(path());
  write_checkpoint(file(12), telling_config(), scene, expected.progress, expected.model);
  const Checkpoint read = read_checkpoint(file(12));
  ASSERT_TRUE(read.state.model.gaussians.has_time);
  EXPECT_TRUE(same_bits(read.state.model, expected.model));
  for (std::size_t i = 0; i < scene.views.size(); ++i)
    EXPECT_EQ(read.scene.views[i].camera.time, 0.1f * float(i));
}

TEST_F(Checkpoints, WithSumsOfDensityControlComeBackBitForBit) {
  for (const bool has_time : {false, true}) {
    TrainingState expected = telling_state(100, 12, has_time);
    begin_sums(expected.model);
    number_rows(expected.model.statistics.sums, 0.5f);
    expected.model.first_count = 77;
    fs::create_directories(path());
    write_checkpoint(file(12), telling_config(), telling_scene(), expected.progress,
                     expected.model);
    const TrainingModel read = read_checkpoint(file(12)).state.model;
    ASSERT_TRUE(read.statistics.has_sums);
    EXPECT_EQ(read.gaussians.has_time, has_time);
    EXPECT_TRUE(same_bits(read, expected.model));
    EXPECT_TRUE(same_bits(read.statistics.sums, expected.model.statistics.sums));
    EXPECT_EQ(read.first_count, 77u);
    EXPECT_NEAR(double(fs::file_size(file(12))), double(checkpoint_bytes(expected.model, 4)),
                16384);
  }
}

TEST_F(Checkpoints, KeepTheLensesOfViews) {
  for (const float turn : {0.0f, 0.125f}) {
    SceneRecord scene = telling_scene();
    CameraLens<float>& lens = scene.views[1].camera.lens;
    lens.lens = Lens::fisheye;
    lens.k[2] = 0.25f, lens.s[3] = -0.5f, lens.radius = 1.75f, lens.high = {2, 3};
    lens.motion.turn.y = turn, lens.rows.y = 4 * turn;
    const TrainingState state = telling_state(3, 12);
    ASSERT_TRUE(CheckpointFolder(path(), telling_config(), scene, free_space)
                    .save(state.progress, state.model));
    const Checkpoint read = read_checkpoint(file(12));
    for (std::size_t i = 0; i < scene.views.size(); ++i)
      EXPECT_EQ(read.scene.views[i].camera.lens, scene.views[i].camera.lens) << i;
  }
}

using Sections = std::vector<std::pair<std::string, std::string>>;  // names and bytes

Sections sections_of(const fs::path& checkpoint, const TrainingModel& model) {
  std::vector<std::string> names{"about",   "config",     "view_names", "views",
                                 "strikes", "view_order", "gaussians"};
  if (model.gaussians.has_time) names.push_back("view_times");
  for (const auto& column : model.columns()) names.push_back(column.key());
  const auto add = [&](const char* name, const auto&) { names.push_back(name); };
  if (!model.photometric.empty()) {
    names.push_back("photometric");
    for_each_photometric_array(add, model.photometric);
  }
  if (!model.poses.empty()) {
    names.push_back("poses");
    for_each_pose_array(add, model.poses);
  }
  CheckedReader file(checkpoint, kKind);
  Sections sections;
  for (const std::string& name : names) sections.emplace_back(name, file.text(name));
  file.finish();
  return sections;
}

void write_sections(const fs::path& to, const Sections& sections,
                    std::uint32_t version = kKind.version) {
  CheckedWriter file(to, {kKind.name, version, version});
  for (const auto& [name, bytes] : sections) file.text(name, bytes);
  file.commit();
}

// Copies a checkpoint; edit(section, text) changes its sections.
template <class Edit>
void rewrite(const fs::path& from, const fs::path& to, const TrainingModel& model, Edit&& edit) {
  Sections sections = sections_of(from, model);
  for (auto& [name, text] : sections) edit(name, text);
  write_sections(to, sections);
}

// Version 1 had moments as floats in two arrays: first ones of all arrays of rows, then second ones.
Sections as_of_version_1(const Sections& sections) {
  Sections result, second;
  for (const auto& [name, bytes] : sections) {
    const std::size_t at = name.find("moments");
    if (at == name.npos) {
      result.insert(result.end(), second.begin(), second.end());
      second.clear();
      result.emplace_back(name, bytes);
      continue;
    }
    std::string halves[2];
    for (std::size_t i = 0; i < bytes.size(); i += 4) halves[i / 4 % 2] += bytes.substr(i, 4);
    const std::string rest = name.substr(at + std::string("moments").size());
    result.emplace_back(name.substr(0, at) + "first_moment" + rest, halves[0]);
    second.emplace_back(name.substr(0, at) + "second_moment" + rest, halves[1]);
  }
  result.insert(result.end(), second.begin(), second.end());
  return result;
}

// Before November 2026, rows of sums had the weights of fragments as the second of four numbers.
void copy_with_older_sums(const fs::path& from, const fs::path& to, const TrainingModel& model) {
  rewrite(from, to, model, [&](const std::string& name, std::string& bytes) {
    if (name != "statistics.sums") return;
    bytes.clear();
    for (const FragmentSums& row : model.statistics.sums) {
      const Vec4f older{row.count, 1000, row.first, row.second};
      bytes.append(reinterpret_cast<const char*>(&older), sizeof older);
    }
  });
}

TEST_F(Checkpoints, OfOlderVersionsComeBackWithoutTheWeightsOfFragments) {
  TrainingState expected = telling_state(100, 12);
  begin_sums(expected.model);
  number_rows(expected.model.statistics.sums, 0.5f);
  fs::create_directories(path());
  write_checkpoint(file(12), telling_config(), telling_scene(), expected.progress, expected.model);
  copy_with_older_sums(file(12), file(13), expected.model);
  const TrainingModel read = read_checkpoint(file(13)).state.model;
  EXPECT_TRUE(same_bits(read, expected.model));
  EXPECT_TRUE(same_bits(read.statistics.sums, expected.model.statistics.sums));
}

TEST_F(Checkpoints, WithA3dFilterComeBackBitForBit) {
  TrainingState expected = telling_state(100, 12);
  expected.model.gaussians.has_filter = true;
  expected.model.gaussians.resize(100);
  number_rows(expected.model.gaussians.filter_scale, 0.5f);
  fs::create_directories(path());
  write_checkpoint(file(12), telling_config(), telling_scene(), expected.progress, expected.model);
  const TrainingModel read = read_checkpoint(file(12)).state.model;
  ASSERT_TRUE(read.gaussians.has_filter);
  EXPECT_TRUE(same_bits(read, expected.model));
  EXPECT_EQ(checkpoint_bytes(expected.model, 4),
            checkpoint_bytes(telling_state(100, 12).model, 4) + 400);
}

TEST_F(Checkpoints, WithHalfMomentsComeBackBitForBitAndAreSmaller) {
  for (const bool has_time : {false, true}) {
    const TrainingState expected = telling_state(100, 12, has_time, MomentStorage::halves);
    fs::create_directories(path());
    write_checkpoint(file(12), telling_config(), telling_scene(), expected.progress,
                     expected.model);
    const TrainingModel read = read_checkpoint(file(12)).state.model;
    ASSERT_EQ(read.moment_storage(), MomentStorage::halves);
    EXPECT_TRUE(same_bits(read, expected.model));
    constexpr unsigned saved = 6;  // bytes of a number
    EXPECT_EQ(checkpoint_bytes(expected.model, 4),
              checkpoint_bytes(telling_state(100, 12, has_time).model, 4) -
                  100 * (has_time ? 65 : 59) * saved);
    EXPECT_NEAR(double(fs::file_size(file(12))), double(checkpoint_bytes(expected.model, 4)),
                16384);
  }
}

TEST_F(Checkpoints, WithAPhotometricModelAndPosesComeBackBitForBit) {
  TrainingState expected = telling_state(100, 12);
  add_photos(expected.model);
  fs::create_directories(path());
  const auto read_again = [&] {
    write_checkpoint(file(12), telling_config(), telling_scene(), expected.progress,
                     expected.model);
    return read_checkpoint(file(12)).state.model;
  };
  EXPECT_TRUE(same_bits(read_again(), expected.model));
  EXPECT_NEAR(double(fs::file_size(file(12))), double(checkpoint_bytes(expected.model, 4)), 16384);
  const TrainingModel sound = copy_to(host_memory(), expected.model);
  expected.model.photometric.values[5] = std::numeric_limits<float>::quiet_NaN();
  EXPECT_THROW(read_again(), Error);
  expected.model.photometric.values[5] = sound.photometric.values[5];
  expected.model.poses.values[5] = std::numeric_limits<float>::quiet_NaN();
  EXPECT_THROW(read_again(), Error);
}

TEST_F(Checkpoints, OfVersion1HaveTheSameMoments) {
  for (const bool has_time : {false, true})
    for (const std::size_t count : {0, 100}) {
      TrainingState expected = telling_state(count, 12, has_time);
      add_photos(expected.model);
      fs::create_directories(path());
      write_checkpoint(file(12), telling_config(), telling_scene(), expected.progress,
                       expected.model);
      const Sections sections = as_of_version_1(sections_of(file(12), expected.model));
      write_sections(file(11), sections, 1);
      EXPECT_TRUE(same_bits(read_checkpoint(file(11)).state.model, expected.model));
      write_sections(file(11), sections, 2);
      EXPECT_THROW(read_checkpoint(file(11)), Error);
    }
}

TEST_F(Checkpoints, OfVersion1WithMomentsOfAnotherNumberOfRowsAreRefused) {
  ASSERT_TRUE(save(folder(), 12));
  Sections sections = as_of_version_1(sections_of(file(12), telling_state(7, 12).model));
  for (auto& [name, bytes] : sections)
    if (name == "second_moment.rotation") bytes.resize(bytes.size() - sizeof(float));
  write_sections(file(11), sections, 1);
  EXPECT_THROW(read_checkpoint(file(11)), Error);
}

TEST_F(Checkpoints, OfALaterVersionAreRefusedByIt) {
  ASSERT_TRUE(save(folder(), 12));
  write_sections(file(11), sections_of(file(12), telling_state(7, 12).model), 3);
  EXPECT_THAT(error_of([&] { read_checkpoint(file(11)); }),
              AllOf(HasSubstr("it has version 3 of its format"), HasSubstr("knows version 2")));
}

// Version 0.1.0 did not write "first_gaussians".
TEST_F(Checkpoints, OfVersionsWithoutTheFirstCountAreRead) {
  ASSERT_TRUE(save(folder(), 12));
  const TrainingState expected = telling_state(7, 12);
  rewrite(file(12), file(11), expected.model, [](const std::string& section, std::string& text) {
    const std::string dropped = "\"first_gaussians\":7,";
    if (section == "about") text.erase(text.find(dropped), dropped.size());
  });
  const TrainingModel read = read_checkpoint(file(11)).state.model;
  EXPECT_TRUE(same_bits(read, expected.model));
  EXPECT_FALSE(read.statistics.has_sums);
  EXPECT_EQ(read.first_count, 0u);
}

TEST_F(Checkpoints, OfVersionsWithMoreSettingsAreReadWhereTheseChangedNothing) {
  ASSERT_TRUE(save(folder(), 12));
  const TrainingModel model = telling_state(7, 12).model;
  const auto read_with = [&](const std::string& line) {
    rewrite(file(12), file(11), model, [&](const std::string& section, std::string& text) {
      if (section == "config") text += line + "\n";
    });
    return read_checkpoint(file(11));
  };
  EXPECT_TRUE(same_bits(read_with("optimizer.lazy = \"auto\"").state.model, model));
  EXPECT_THAT(error_of([&] { read_with("optimizer.lazy = \"on\""); }),
              AllOf(HasSubstr("of another version"), HasSubstr("no longer left for later")));
}

TEST_F(Checkpoints, WithWhatWasRemovedSayWhatItIs) {
  ASSERT_TRUE(save(folder(), 12));
  const TrainingModel model = telling_state(7, 12).model;
  for (const auto& [bit, what] : {std::pair{128u, "optimizer.lazy"},
                                  {64u, "moments in 32 bits"},
                                  {8u, "model.time_colors"}}) {
    rewrite(file(12), file(11), model, [bit = bit](const std::string& section, std::string& text) {
      if (section == "gaussians")
        text += std::string{char(bit & 255), char(bit >> 8), 0, 0, 0, 0, 0, 0};
    });
    EXPECT_THAT(error_of([&] { read_checkpoint(file(11)); }),
                AllOf(HasSubstr(what), HasSubstr("start from its model")));
  }
}

TEST_F(Checkpoints, WithVignettingSayWhatItIs) {
  TrainingState state = telling_state(7, 12);
  state.model.photometric.begin(3, 3);
  fs::create_directories(path());
  write_checkpoint(file(12), telling_config(), telling_scene(), state.progress, state.model);
  rewrite(file(12), file(11), state.model, [](const std::string& section, std::string& text) {
    if (section == "photometric") text[8] = 1, text[12] = 3;  // a camera of three numbers
  });
  EXPECT_THAT(error_of([&] { read_checkpoint(file(11)); }),
              AllOf(HasSubstr("vignetting"), HasSubstr("start from its model")));
}

// ppisp had nine.
TEST_F(Checkpoints, WithMoreNumbersOfAPhotoSayWhatTheyAre) {
  TrainingState state = telling_state(7, 12);
  state.model.photometric.begin(3, 3);
  fs::create_directories(path());
  write_checkpoint(file(12), telling_config(), telling_scene(), state.progress, state.model);
  rewrite(file(12), file(11), state.model, [](const std::string& section, std::string& text) {
    if (section == "photometric") text[4] = 9;
  });
  EXPECT_THAT(error_of([&] { read_checkpoint(file(11)); }),
              AllOf(HasSubstr("a photometric model"), HasSubstr("start from its model")));
}

TEST_F(Checkpoints, KnowTheirScene) {
  ASSERT_TRUE(save(folder(), 12));
  const SceneRecord read = read_checkpoint(file(12)).scene, expected = telling_scene();
  EXPECT_EQ(read.extent, expected.extent);
  EXPECT_EQ(read.world_offset, expected.world_offset);
  ASSERT_EQ(read.views.size(), expected.views.size());
  for (std::size_t i = 0; i < read.views.size(); ++i) {
    const ViewRecord &a = read.views[i], &b = expected.views[i];
    EXPECT_EQ(a.name, b.name);
    EXPECT_EQ(a.is_test, b.is_test);
    EXPECT_EQ(a.camera.width, b.camera.width);
    EXPECT_EQ(a.camera.height, b.camera.height);
    EXPECT_EQ(a.camera.fx, b.camera.fx);
    EXPECT_EQ(a.camera.fy, b.camera.fy);
    EXPECT_EQ(a.camera.cx, b.camera.cx);
    EXPECT_EQ(a.camera.cy, b.camera.cy);
    const Mat3<float>&x = a.camera.cam_from_world_rotation, &y = b.camera.cam_from_world_rotation;
    EXPECT_TRUE(x.row0 == y.row0 && x.row1 == y.row1 && x.row2 == y.row2);
    EXPECT_EQ(a.camera.cam_from_world_translation, b.camera.cam_from_world_translation);
    EXPECT_EQ(a.exposure, b.exposure);
  }
}

TEST_F(Checkpoints, TakeAsMuchSpaceAsForetold) {
  ASSERT_TRUE(save(folder(), 12, 1000));
  const auto foretold = double(checkpoint_bytes(telling_state(1000, 12).model, 4));
  EXPECT_NEAR(double(fs::file_size(file(12))), foretold, 16384);
}

TEST_F(Checkpoints, CutShortAnywhereAreRefusedByName) {
  ASSERT_TRUE(save(folder(), 12, 1));
  const std::string whole = read_bytes(file(12));
  const fs::path cut = path() / "cut";
  for (std::size_t bytes = 0; bytes < whole.size(); ++bytes) {
    write_bytes(cut, whole.substr(0, bytes));
    try {
      read_checkpoint(cut);
      FAIL() << "taken with " << bytes << " of " << whole.size() << " bytes";
    } catch (const Error& error) {
      ASSERT_THAT(error.what(), HasSubstr(cut.string()));
    }
  }
  write_bytes(cut, whole + "x");
  EXPECT_THROW(read_checkpoint(cut), Error);
}

TEST_F(Checkpoints, WithAFlippedBitAnywhereAreRefusedByName) {
  ASSERT_TRUE(save(folder(), 12, 1));
  std::string bytes = read_bytes(file(12));
  const fs::path flipped = path() / "flipped";
  for (std::size_t i = 0; i < bytes.size(); ++i) {
    bytes[i] ^= char(1 << i % 8);
    write_bytes(flipped, bytes);
    try {
      read_checkpoint(flipped);
      FAIL() << "taken with byte " << i << " of " << bytes.size() << " changed";
    } catch (const Error& error) {
      ASSERT_THAT(error.what(), HasSubstr(flipped.string()));
    }
    bytes[i] ^= char(1 << i % 8);
  }
}

// Their checksum is right.
TEST_F(Checkpoints, WithForgedNumbersAreRefusedByName) {
  const TrainingState sound = telling_state(1, 12);
  const auto error_of = [&](const RunProgress& progress) {
    const fs::path forged = path() / "forged";
    write_checkpoint(forged, telling_config(), telling_scene(), progress, sound.model);
    try {
      read_checkpoint(forged);
    } catch (const Error& error) {
      return std::string(error.what());
    }
    return std::string("taken");
  };
  EXPECT_EQ(error_of(sound.progress), "taken");
  RunProgress before_the_start = sound.progress, too_many_degrees = sound.progress,
              no_loss = sound.progress;
  before_the_start.step = -1;
  too_many_degrees.sh_degree = std::numeric_limits<int>::max();
  no_loss.loss = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THAT(error_of(before_the_start), HasSubstr("forged: step is no whole number from 0"));
  EXPECT_THAT(error_of(too_many_degrees), HasSubstr("forged: sh_degree is no whole number from 0"));
  EXPECT_THAT(error_of(no_loss), HasSubstr("forged: loss is no number"));
}

// The bytes are those of one that was written at once.
TEST_F(Checkpoints, TheLastOneOfADeviceIsWrittenInTheBackground) {
  const TrainingState state = telling_state(40, 20);
  CountedMemory device;
  const TrainingModel model = copy_to(device, state.model);
  CheckpointFolder checkpoints = folder();
  ASSERT_TRUE(checkpoints.save(state.progress, model));
  const std::string at_once = read_bytes(file(20));
  for (const int last_step : {20, 30}) {
    fs::remove(file(20));
    LastCheckpoint last(checkpoints, last_step);
    EXPECT_TRUE(last.save(state.progress, model));
    EXPECT_TRUE(last.newest());  // waits
    EXPECT_EQ(read_bytes(file(20)), at_once);
  }
}

TEST_F(Checkpoints, TheLastOneWarnsWhereItCannotBeWritten) {
  const TrainingState state = telling_state(40, 20);
  CountedMemory device;
  const TrainingModel model = copy_to(device, state.model);
  CheckpointFolder checkpoints = folder([](const fs::path&) { return std::uint64_t(10); });
  LastCheckpoint last(checkpoints, 20);
  CapturedLog logged;
  EXPECT_TRUE(last.save(state.progress, model));
  last.wait();
  EXPECT_THAT(logged.text(), HasSubstr("no checkpoint of step 20"));
  EXPECT_FALSE(fs::exists(file(20)));
}

TEST_F(Checkpoints, OnlyTheLastTwoAreKept) {
  for (const int step : {5, 10, 15, 20}) ASSERT_TRUE(save(folder(), step));
  EXPECT_THAT(steps_in(path()), ElementsAre(20, 15));
  folder().keep_only_newest();
  EXPECT_THAT(steps_in(path()), ElementsAre(20));
}

TEST_F(Checkpoints, ADamagedOneIsNamedSetAsideAndTheOlderOneTaken) {
  for (const int step : {5, 10}) ASSERT_TRUE(save(folder(), step));
  std::string bytes = read_bytes(file(10));
  bytes[bytes.size() / 2] ^= 4;
  write_bytes(file(10), bytes);
  const std::optional<TrainingState> found = folder().newest();
  ASSERT_TRUE(found);
  EXPECT_EQ(found->progress.step, 5);
  EXPECT_TRUE(fs::exists(file(10).string() + ".refused"));
  EXPECT_THAT(steps_in(path()), ElementsAre(5));
}

TEST_F(Checkpoints, TheHeadIsReadWithoutTheArraysAndNoFileIsRenamed) {
  ASSERT_TRUE(save(folder(), 10, 1000));
  const Checkpoint whole = read_checkpoint(file(10));
  fs::resize_file(file(10), fs::file_size(file(10)) / 2);  // most of it is arrays
  const Checkpoint head = read_checkpoint(file(10), CheckpointPart::head);
  EXPECT_EQ(head.state.progress.step, 10);
  EXPECT_EQ(to_toml(head.config), to_toml(whole.config));
  EXPECT_EQ(head.state.model.count(), 0u);
  EXPECT_TRUE(newest_checkpoint(path(), CheckpointPart::head));
  EXPECT_TRUE(fs::exists(file(10)));
  EXPECT_FALSE(newest_checkpoint(path()));
}

TEST_F(Checkpoints, WithoutAnyThereIsNone) {
  EXPECT_FALSE(folder().newest());
  write_bytes(path() / "step_x.ckpt", "not one");
  write_bytes(path() / "step_3.ckpt", "damaged");
  EXPECT_FALSE(folder().newest());
}

// A link that leads to itself stands for a file that the system does not let us read, also for root.
TEST_F(Checkpoints, OneThatCannotBeReadNowIsAnErrorAndStays) {
  ASSERT_TRUE(save(folder(), 5));
  fs::create_symlink("step_10.ckpt", file(10));
  EXPECT_THROW(newest_checkpoint(path()), AccessError);
  EXPECT_TRUE(fs::is_symlink(file(10)));
  EXPECT_TRUE(fs::exists(file(5)));
}

TEST_F(Checkpoints, AFullDiskIsSeenBeforehandAndNothingIsLost) {
  for (const int step : {5, 10}) ASSERT_TRUE(save(folder(), step));
  EXPECT_FALSE(save(folder([](const fs::path&) { return std::uint64_t(1000); }), 15));
  EXPECT_THAT(steps_in(path()), ElementsAre(10));  // removing the older one did not free enough
  EXPECT_TRUE(folder().newest());
}

TEST_F(Checkpoints, ASmallOneNeedsLittleSpace) {
  EXPECT_TRUE(save(folder([](const fs::path&) { return std::uint64_t(300'000); }), 5, 100));
  EXPECT_FALSE(save(folder([](const fs::path&) { return std::uint64_t(100'000); }), 10, 100));
  EXPECT_THAT(steps_in(path()), ElementsAre(5));
}

TEST_F(Checkpoints, TheOlderOneMakesSpaceWhereThatIsEnough) {
  for (const int step : {5, 10}) ASSERT_TRUE(save(folder(), step));
  const auto space = [&](const fs::path&) {
    return steps_in(path()).size() < 2 ? ~std::uint64_t(0) : std::uint64_t(1000);
  };
  EXPECT_TRUE(save(folder(space), 15));
  EXPECT_THAT(steps_in(path()), ElementsAre(15, 10));
}

/// Calls a function at its k-th point of writing.
class AtWritePoint final : public WriteHook {
 public:
  AtWritePoint(int point, void (*f)()) : left_(point), f_(f) { set_write_hook(this); }
  ~AtWritePoint() override { set_write_hook(nullptr); }
  void before(WritePoint, const fs::path&) override {
    if (--left_ == 0) f_();
  }
  bool was_reached() const { return left_ <= 0; }

 private:
  int left_;
  void (*f_)();
};

TEST_F(Checkpoints, AKillAtAnyPointOfWritingLeavesTheOldOnesOrTheNewOne) {
  for (const int step : {5, 10}) ASSERT_TRUE(save(folder(), step));
  int kills = 0;
  for (bool is_killed = true; is_killed; ++kills) {
    const pid_t child = fork();
    ASSERT_GE(child, 0);
    if (child == 0) {
      AtWritePoint kill_here(kills + 1, [] { ::kill(::getpid(), SIGKILL); });
      ::_exit(save(folder(), 15) ? 0 : 1);
    }
    int status = 0;
    ASSERT_EQ(::waitpid(child, &status, 0), child);
    is_killed = WIFSIGNALED(status);
    EXPECT_TRUE(is_killed || WEXITSTATUS(status) == 0);
    remove_leftovers(path());
    for (const auto& entry : fs::directory_iterator(path()))
      EXPECT_TRUE(entry.path().filename().string().starts_with("step_")) << entry.path();
    const std::vector<int> steps = steps_in(path());
    ASSERT_FALSE(steps.empty());
    EXPECT_TRUE(steps[0] == 15 || steps == (std::vector<int>{10, 5})) << steps[0];
    for (const int step : steps)  // none of them is damaged
      EXPECT_TRUE(same_bits(read_checkpoint(file(step)).state.model, telling_state(7, step).model));
    if (steps[0] == 15) fs::remove(file(15));
    if (steps.back() == 10) {
      ASSERT_TRUE(save(folder(), 5) && save(folder(), 10));
    }
  }
  EXPECT_GT(kills, 60);  // sections, pieces of them, sync, rename
}

TEST_F(Checkpoints, AWriteThatFailsIsToldAndLeavesTheOldOnes) {
  for (const int step : {5, 10}) ASSERT_TRUE(save(folder(), step));
  for (int point = 1;; ++point) {
    AtWritePoint fail_here(point, [] { throw Error("the disk is full, says the test"); });
    const bool is_saved = save(folder(), 15);
    if (!fail_here.was_reached()) break;
    if (is_saved) continue;
    const std::optional<TrainingState> found = folder().newest();
    ASSERT_TRUE(found);
    EXPECT_TRUE(found->progress.step == 10 || found->progress.step == 15);
  }
  EXPECT_THAT(steps_in(path()), ElementsAre(15, 10));
}

TEST_F(Checkpoints, OnlyLeftoversOfProcessesThatAreGoneAreRemoved) {
  const pid_t gone = fork();
  if (gone == 0) ::_exit(0);
  ::waitpid(gone, nullptr, 0);
  const auto name = [](const std::string& of, pid_t process) {
    return "." + of + "." + std::to_string(process) + ".0123456789abcdef.tmp";
  };
  for (const std::string& kept :
       {name("step_5.ckpt", ::getpid()), std::string("notes.tmp"), std::string(".tmp"),
        std::string("..tmp"), ".notes." + std::to_string(gone) + ".backup.tmp",
        std::string("step_5.ckpt")})
    write_bytes(path() / kept, "x");
  write_bytes(path() / name("step_5.ckpt", gone), "x");
  remove_leftovers(path());
  EXPECT_FALSE(fs::exists(path() / name("step_5.ckpt", gone)));
  EXPECT_EQ(std::distance(fs::directory_iterator(path()), {}), 6);
}

}  // namespace
}  // namespace gs
