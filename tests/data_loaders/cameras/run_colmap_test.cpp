// SPDX-License-Identifier: Apache-2.0
// From photos to a scene: once with the installed colmap on bundled pictures, and otherwise with a
// shell script in its place that prints, writes and returns what a test needs.
#include "data_loaders/reconstruct/run_colmap.h"

#include <gmock/gmock.h>
#include <signal.h>
#include <unistd.h>

#include <atomic>
#include <chrono>
#include <cstring>
#include <map>
#include <thread>
#include <tuple>

#include "data_loaders/colmap/colmap_model.h"
#include "data_loaders/photos/encode/encode_jpeg.h"
#include "data_loaders/photos/encode/encode_png.h"
#include "data_loaders/photos/photos.h"
#include "data_loaders/reconstruct/colmap_log.h"
#include "data_loaders/reconstruct/foreign_cameras.h"
#include "data_loaders/reconstruct/panorama_views.h"
#include "data_loaders/reconstruct/photo_folder.h"
#include "data_loaders/video/video_frames.h"
#include "gs_core/error.h"
#include "gs_core/math/render/quaternion.h"
#include "gs_core/math/render/rotation.h"
#include "gs_core/system/files/atomic_file.h"
#include "gs_core/system/files/output_lock.h"
#include "gs_core/system/processes/subprocess.h"
#include "gs_core/system/text/read_json.h"
#include "tests/support/avi_writer.h"
#include "tests/support/captured_log.h"
#include "tests/support/error_of.h"
#include "tests/support/folder_test.h"
#include "tests/support/foreign_leaks.h"
#include "tests/support/scenes.h"
#include "tests/support/tiny_photos.h"

namespace gs {
namespace {

namespace fs = std::filesystem;
using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::Not;
using testing::SizeIs;

// Neighbors in the bundled scene; no three of these views are on one line.
constexpr const char* kViews[] = {"002", "003", "004", "015", "016",
                                  "017", "028", "029", "030", "031"};

const ColmapProgress kSilent = [](ColmapStage, std::int64_t, std::int64_t) {};

// Prints what a real colmap prints; its mapper copies the model that lies beside it.
constexpr const char* kGoodColmap = R"sh(#!/bin/sh
echo "$1" >> "$(dirname "$0")/calls"
case "$*" in *" -h") echo "  --SiftExtraction.use_gpu arg (=1)"; exit 0;; esac
case "$1" in
  feature_extractor)
    n=0
    for name in a b c d; do
      n=$((n + 1))
      printf 'Processed file [%d/4]\n  Name:            %s.png\n' $n $name
      echo "  Features:        $((5 - n))00"
    done;;
  exhaustive_matcher) echo "Matching block [1/1, 1/1] in 0.1s";;
  mapper)
    echo "Registering image #3 (3)"; echo "  => Image sees 119 / 933 points"
    while [ "$1" != --output_path ]; do shift; done
    cp -r "$(dirname "$0")/model" "$2/0";;
esac
)sh";

/// Four photos, a script in place of colmap, and its model of the first three.
class FakeColmap : public FolderTest {
 protected:
  FakeColmap() {
    for (const char* name : {"a.png", "b.png", "c.png", "d.png"})
      write_png(photos() / name, plain_photo(12, 8, 100));
    install(kGoodColmap);
    write_binary_model(path("model"), small_model(3));
  }

  fs::path photos() const { return path("photos"); }
  fs::path scene() const { return path("scene"); }
  void install(const std::string& script) {
    write_bytes(path("colmap"), script);
    fs::permissions(path("colmap"), fs::perms::owner_all);
  }
  /// The good one, which does this first.
  void install_before(const std::string& lines) {
    install(std::string(kGoodColmap).insert(std::strlen("#!/bin/sh\n"), lines));
  }
  ColmapJob job() const {
    ColmapJob result;
    result.photos = photos();
    result.scene = scene();
    result.settings.colmap = (path("colmap")).string();
    return result;
  }
  /// The folder in the scene's where an unfinished one is made.
  fs::path work() const {
    for (const auto& entry : fs::directory_iterator(scene()))
      if (entry.is_directory() && entry.path().filename().string().starts_with(".gemsplat-"))
        return entry.path();
    return {};
  }
  /// The commands of COLMAP that ran since the last call, and those that were asked for help.
  std::string take_calls() {
    std::string calls = read_bytes(path("calls"));
    fs::remove(path("calls"));
    return calls;
  }
  std::string error_of(const ColmapJob& wanted) {
    return gs::error_of([&] { run_colmap(wanted, kSilent); });
  }
};

TEST(RunColmap, InstalledColmapPlacesThePhotosAndContinuesWhereItStopped) {
  if (!find_program("colmap")) GTEST_SKIP() << "the program colmap is not installed";
  const TempFolder temp;
  ColmapJob job;
  job.photos = temp.path() / "photos";
  job.scene = temp.path() / "scene";
  job.threads = 2;
  job.settings.max_features = 2000;  // the time of matching grows with its square
  fs::create_directories(job.photos);
  for (const std::string view : kViews) {
    const std::string name = "view_" + view + ".jpg";
    fs::copy_file(fs::path(GS_SOURCE_DIR) / "examples/courtyard/images" / name, job.photos / name);
  }

  std::int64_t done[5] = {}, totals[5] = {};  // of ColmapStage; the first two are not used
  const auto progress = [&](ColmapStage stage, std::int64_t so_far, std::int64_t total) {
    done[int(stage)] = so_far;
    totals[int(stage)] = total;
  };
  const Reconstruction result = run_colmap(job, progress);
  EXPECT_EQ(result.photos, std::size(kViews));
  EXPECT_GE(result.registered, 8u);  // all of them in COLMAP 3.8; it draws random numbers
  EXPECT_EQ(result.registered + result.missing.size(), result.photos);
  EXPECT_GT(result.points, 300u);
  EXPECT_LT(result.mean_error, 1);  // pixels; 0.3 in COLMAP 3.8
  EXPECT_GT(result.mean_error, 0);
  EXPECT_EQ(read_colmap_model(job.scene / "sparse/0").images.size(), result.registered);
  EXPECT_EQ(done[2], totals[2]);
  EXPECT_EQ(done[3], totals[3]);
  EXPECT_GE(done[4], std::int64_t(result.registered));
  EXPECT_EQ(read_colmap_log(job.scene / "colmap.log").photos.size(), result.photos);

  int started = 0;
  const auto count = [&](ColmapStage, std::int64_t so_far, std::int64_t) {
    started += so_far == 0;
  };
  EXPECT_EQ(run_colmap(job, count).registered, result.registered);
  EXPECT_EQ(started, 0);

  std::string state = read_bytes(job.scene / "reconstruct.json");  // as after a kill in the matcher
  const std::size_t list = state.find('[');
  write_bytes(job.scene / "reconstruct.json", state.substr(0, list) + "[\"features\"]}");
  fs::remove_all(job.scene / "sparse");
  EXPECT_GE(run_colmap(job, count).registered, 8u);
  EXPECT_EQ(started, 2);
}

TEST(RunColmap, InstalledColmapFindsPointsForKnownCameras) {
  if (!find_program("colmap")) GTEST_SKIP() << "the program colmap is not installed";
  const TempFolder temp;
  const fs::path courtyard = fs::path(GS_SOURCE_DIR) / "examples/courtyard";
  ColmapModel model = read_colmap_model(courtyard / "sparse/0");
  model.points.clear();
  std::erase_if(model.images, [](const ColmapImage& image) {
    return std::ranges::none_of(
        kViews, [&](const std::string view) { return image.name == "view_" + view + ".jpg"; });
  });
  for (ColmapImage& image : model.images) image.id += 100;  // COLMAP has ids of its own
  ColmapJob job;
  job.photos = courtyard / "images";
  job.scene = temp.path() / "scene";
  job.threads = 2;
  job.settings.max_features = 2000;
  job.poses = std::make_shared<const ColmapModel>(model);
  const Reconstruction result = run_colmap(job, kSilent);
  EXPECT_EQ(result.registered, std::size(kViews));
  EXPECT_GT(result.points, 300u);
  EXPECT_LT(result.mean_error, 1);
  const ColmapModel made = read_colmap_model(job.scene / "sparse/0");
  for (const ColmapImage& image : model.images) {
    const auto same = std::ranges::find(made.images, image.name, &ColmapImage::name);
    ASSERT_NE(same, made.images.end());
    EXPECT_NEAR(same->cam_from_world_translation.x, image.cam_from_world_translation.x, 1e-9);
  }
  EXPECT_EQ(made.cameras.begin()->second.params, model.cameras.begin()->second.params);
}

TEST_F(FakeColmap, SceneHasPhotosModelLogAndVerdict) {
  const Reconstruction result = run_colmap(job(), kSilent);
  EXPECT_EQ(result.registered, 3u);
  EXPECT_EQ(result.models, 1u);
  ASSERT_THAT(result.missing, SizeIs(1));
  EXPECT_EQ(result.missing[0].name, "d.png");
  EXPECT_THAT(describe(result),
              AllOf(HasSubstr("3 of 4 photos placed"), HasSubstr("missing: d.png")));
  EXPECT_TRUE(fs::exists(photos() / "d.png"));
  EXPECT_TRUE(fs::exists(scene() / "images/d.png"));
  EXPECT_THAT(read_bytes(scene() / "colmap.log"), HasSubstr("Processed file [4/4]"));
}

TEST_F(FakeColmap, OptionsAreThoseThatTheVersionKnows) {
  run_colmap(job(), kSilent);
  EXPECT_THAT(read_bytes(scene() / "colmap.log"),
              AllOf(HasSubstr("--SiftExtraction.use_gpu 0"), Not(HasSubstr("FeatureExtraction"))));
}

TEST_F(FakeColmap, AGpuIsUsedWhereColmapHasCuda) {
  install_before("[ \"$1\" = help ] && echo '  (Commit 1 on 2026 with CUDA)'\n");
  run_colmap(job(), kSilent);
  EXPECT_THAT(read_bytes(scene() / "colmap.log"),
              AllOf(HasSubstr("--SiftExtraction.use_gpu 1"), Not(HasSubstr("use_gpu 0"))));
  fs::remove_all(scene());
  ColmapJob on_cpu = job();
  on_cpu.settings.use_gpu = false;
  run_colmap(on_cpu, kSilent);
  EXPECT_THAT(read_bytes(scene() / "colmap.log"), Not(HasSubstr("use_gpu 1")));
}

TEST_F(FakeColmap, AfterAFailureOnTheGpuTheCpuDoesIt) {
  install_before(R"sh([ "$1" = help ] && echo '  (Commit 1 on 2026 with CUDA)'
case "$*" in *"use_gpu 1"*) echo no device; exit 1;; esac
)sh");
  const CapturedLog logged;
  EXPECT_EQ(run_colmap(job(), kSilent).registered, 3u);
  EXPECT_THAT(logged.text(), HasSubstr("COLMAP failed on the GPU while finding features"));
  EXPECT_THAT(take_calls(), HasSubstr("feature_extractor\nfeature_extractor\nexhaustive"));
  EXPECT_THAT(read_bytes(scene() / "colmap.log"), HasSubstr("--SiftExtraction.use_gpu 0"));
}

TEST_F(FakeColmap, RetrievalMatchesPhotosThatLookAlike) {
  for (int i = 0; i < 197; ++i)
    write_png(photos() / std::to_string(i).append(".png"), plain_photo(12, 8, 100));
  install_before("[ $# = 2 ] && echo '  --max_num_images arg (=-1)'\n");
  run_colmap(job(), kSilent);
  EXPECT_THAT(
      read_bytes(scene() / "colmap.log"),
      AllOf(HasSubstr("vocabulary.bin --num_visual_words 4096"), HasSubstr("--max_num_images 50\n"),
            HasSubstr("vocabulary.bin --VocabTreeMatching.num_images 50"),
            Not(HasSubstr("exhaustive"))));
  EXPECT_FALSE(fs::exists(work()));
  fs::remove(photos() / "0.png");  // 200
  fs::remove_all(scene());
  run_colmap(job(), kSilent);
  EXPECT_THAT(read_bytes(scene() / "colmap.log"),
              AllOf(HasSubstr("exhaustive_matcher"), Not(HasSubstr("vocab"))));
}

/// The commands of COLMAP 4; global_mapper copies the model `global`.
constexpr const char* kNewCommands = R"sh(
case "$*" in
  help) echo '  global_mapper'; echo '  view_graph_calibrator';;
  *" -h") ;;
  feature_extractor*) : > "$3";;
  global_mapper*)
    [ -d "$(dirname "$0")/global" ] || { echo Failed to create sparse model; exit 1; }
    cp -r "$(dirname "$0")/global" "${7}/0";;
esac
)sh";

TEST_F(FakeColmap, TheGlobalMapperWorksOnACopyOfTheDatabase) {
  install_before(kNewCommands);
  write_binary_model(path("global"), small_model(4));
  ColmapJob global = job();
  global.settings.mapper = Mapper::global;
  EXPECT_EQ(run_colmap(global, kSilent).registered, 4u);
  EXPECT_THAT(read_bytes(scene() / "colmap.log"),
              AllOf(HasSubstr("view_graph_calibrator --database_path " + scene().string() + "/."),
                    Not(HasSubstr("colmap mapper"))));
  EXPECT_EQ(run_colmap(global, kSilent).registered, 4u);  // finished
  EXPECT_THAT(error_of(job()), HasSubstr("holds a scene already, of other photos or settings"));
}

TEST_F(FakeColmap, TheIncrementalMapperFollowsWhereTheGlobalOneFails) {
  install_before(kNewCommands);
  ColmapJob global = job();
  global.settings.mapper = Mapper::global;
  CapturedLog logged;
  EXPECT_EQ(run_colmap(global, kSilent).registered, 3u);
  EXPECT_THAT(logged.text(), HasSubstr("the global mapper failed; the incremental one"));
  fs::remove_all(scene());
  write_binary_model(path("global"), small_model(1));
  const Reconstruction result = run_colmap(global, kSilent);
  EXPECT_EQ(result.registered, 3u);
  EXPECT_EQ(result.models, 1u);
  EXPECT_THAT(logged.text(), HasSubstr("the global mapper placed 1 of 4 photos"));
}

TEST_F(FakeColmap, TheGlobalMapperIsForManyPhotosAndForNewerVersions) {
  ColmapJob global = job();
  global.settings.mapper = Mapper::global;
  EXPECT_THAT(error_of(global), AllOf(HasSubstr("no command global_mapper, which COLMAP 4 has"),
                                      HasSubstr("--set reconstruct.mapper=incremental")));
  write_binary_model(path("global"), small_model(3));
  install_before(kNewCommands);
  run_colmap(job(), kSilent);
  EXPECT_THAT(take_calls(), Not(HasSubstr("global")));
  fs::remove_all(scene());
  for (int i = 0; i < 497; ++i)
    write_png(photos() / std::to_string(i).append(".png"), plain_photo(12, 8, 100));
  run_colmap(job(), kSilent);
  EXPECT_THAT(take_calls(), HasSubstr("global_mapper"));
  EXPECT_THAT(read_bytes(scene() / "colmap.log"), HasSubstr("colmap mapper"));  // 3 of 501
}

TEST_F(FakeColmap, ReasonForAMissingPhotoIsTakenFromTheLog) {
  ColmapModel model = small_model(2);
  model.images.push_back(small_model(4).images[3]);  // a, b, d; c was tried and saw 119 points
  write_binary_model(path("model"), model);
  const Reconstruction tried = run_colmap(job(), kSilent);
  ASSERT_THAT(tried.missing, SizeIs(1));
  EXPECT_THAT(tried.missing[0].reason, HasSubstr("119 of the model's points seen"));
}

TEST_F(FakeColmap, PhotoWithFewFeaturesIsCalledSo) {
  EXPECT_THAT(run_colmap(job(), kSilent).missing.at(0).reason, HasSubstr("too few features (100)"));
}

TEST_F(FakeColmap, FinishedSceneIsNotMadeAgain) {
  run_colmap(job(), kSilent);
  take_calls();
  EXPECT_EQ(run_colmap(job(), kSilent).registered, 3u);
  EXPECT_EQ(take_calls(), "");
}

TEST_F(FakeColmap, FailureShowsTheEndOfTheLogAndLaterContinuesThere) {
  install("#!/bin/sh\ncase \"$1\" in *matcher) echo out of luck; exit 7;; esac\n");
  EXPECT_THAT(error_of(job()), AllOf(HasSubstr("exit code 7"), HasSubstr("out of luck"),
                                     HasSubstr((scene() / "colmap.log").string())));
  install(kGoodColmap);
  run_colmap(job(), kSilent);
  EXPECT_EQ(take_calls(),
            "help\nexhaustive_matcher\nexhaustive_matcher\nmapper\nmapper\n");  // help first
}

TEST_F(FakeColmap, OtherSettingsNeedForceWhichMovesTheSceneAway) {
  run_colmap(job(), kSilent);
  ColmapJob other = job();
  other.settings.max_features = 1000;
  EXPECT_THAT(error_of(other), AllOf(HasSubstr("holds a scene already"), HasSubstr("--force")));
  other.force = true;
  run_colmap(other, kSilent);
  EXPECT_TRUE(is_colmap_model(scene().string() + ".bak-1/sparse/0"));
  EXPECT_TRUE(is_colmap_model(scene() / "sparse/0"));
}

TEST_F(FakeColmap, SceneOfAnotherProgramIsLeftAlone) {
  write_bytes(scene() / "sparse/0/cameras.bin", "dear");
  EXPECT_THAT(error_of(job()), HasSubstr("holds a scene already"));
  EXPECT_EQ(read_bytes(scene() / "sparse/0/cameras.bin"), "dear");
}

TEST_F(FakeColmap, PhotosInTheScenesImagesAreTakenWhereTheyAre) {
  fs::create_directories(scene());
  fs::rename(photos(), scene() / "images");
  ColmapJob in_place = job();
  in_place.photos = scene() / "images";
  EXPECT_EQ(run_colmap(in_place, kSilent).registered, 3u);
  in_place.photos = scene();
  EXPECT_EQ(run_colmap(in_place, kSilent).registered, 3u);
  in_place.force = true;
  EXPECT_THAT(error_of(in_place), AllOf(HasSubstr("cannot move"), HasSubstr("lies in it")));
}

/// A photo of 16 x 8 pixels whose EXIF asks for a turn by 90 degrees.
void write_turned_photo(const fs::path& file) {
  write_bytes(file, {reinterpret_cast<const char*>(kTurnedJpeg), sizeof kTurnedJpeg});
}

TEST_F(FakeColmap, PhotosComeUprightIntoTheScene) {
  write_turned_photo(photos() / "e.jpg");
  const std::string before = read_bytes(photos() / "e.jpg");
  run_colmap(job(), kSilent);
  EXPECT_EQ(read_bytes(photos() / "e.jpg"), before);
  const Image8 photo = read_photo(scene() / "images/e.jpg");
  ASSERT_EQ(photo.width, 8);
  EXPECT_GT(photo.at(4, 1, 0), 150);  // red at the top
  EXPECT_EQ(read_photo_orientation(scene() / "images/e.jpg"), 1);
  take_calls();
  run_colmap(job(), kSilent);
  EXPECT_EQ(take_calls(), "");  // complete
}

TEST_F(FakeColmap, PhotosThatColmapDoesNotReadAreCopiedInAFormatThatItReads) {
  const fs::path heic = photos() / "e.heic";
  write_bytes(heic, {reinterpret_cast<const char*>(kHeic), sizeof kHeic});
  try {
    read_photo(heic);
  } catch (const Error&) {
    GTEST_SKIP() << "this build reads no HEIC";
  }
  run_colmap(job(), kSilent);
  const Image8 photo = read_photo(scene() / "images/e.jpg");
  EXPECT_EQ(photo.width, 64);
  EXPECT_GT(photo.at(8, 8, 0), 150);   // red on the left
  EXPECT_GT(photo.at(56, 8, 2), 150);  // blue on the right
  EXPECT_FALSE(fs::exists(scene() / "images/e.heic"));
  EXPECT_TRUE(fs::exists(heic));
}

TEST_F(FakeColmap, PortraitsAndLandscapesOfOneLensAreOneCameraEach) {
  for (const char* name : {"a.png", "b.png"}) write_png(photos() / name, plain_photo(8, 12, 100));
  std::int64_t most = 0;
  run_colmap(job(), [&](ColmapStage stage, std::int64_t, std::int64_t total) {
    if (stage == ColmapStage::features) most = std::max(most, total);
  });
  EXPECT_EQ(most, 4);  // the photos of both
  const std::string log = read_bytes(scene() / "colmap.log");
  const std::string call = "## colmap feature_extractor";
  const std::size_t first = log.find(call);
  EXPECT_NE(log.find(call, first + 1), log.npos);
  EXPECT_THAT(log, Not(HasSubstr("--ImageReader.single_camera 0")));
  write_png(photos() / "a.png", plain_photo(9, 12, 100));  // of another camera
  fs::remove_all(scene());
  run_colmap(job(), kSilent);
  EXPECT_THAT(read_bytes(scene() / "colmap.log"), HasSubstr("--ImageReader.single_camera 0"));
}

TEST_F(FakeColmap, APhotoOfTheScenesOwnThatIsOnItsSideIsNotChanged) {
  write_turned_photo(photos() / "e.jpg");
  const std::string before = read_bytes(photos() / "e.jpg");
  fs::create_directories(scene());
  fs::rename(photos(), scene() / "images");
  ColmapJob in_place = job();
  in_place.photos = scene();
  run_colmap(in_place, kSilent);
  EXPECT_EQ(read_bytes(scene() / "images/e.jpg"), before);
}

TEST_F(FakeColmap, TheUsersFilesInTheFolderStayAsTheyAre) {
  fs::create_directories(scene());
  fs::rename(photos(), scene() / "images");
  for (const char* name : {"mapping/0/notes.txt", "photos.txt", ".gemsplat-abcdef/x", "sparse.txt"})
    write_bytes(scene() / name, "dear");
  ColmapJob in_place = job();
  in_place.photos = scene();
  EXPECT_EQ(run_colmap(in_place, kSilent).registered, 3u);
  in_place.settings.max_features = 1000;
  EXPECT_THAT(error_of(in_place), HasSubstr("holds a scene already"));
  for (const char* name : {"mapping/0/notes.txt", "photos.txt", ".gemsplat-abcdef/x", "sparse.txt"})
    EXPECT_EQ(read_bytes(scene() / name), "dear") << name;
}

TEST_F(FakeColmap, AFileThatIsNotOursIsNotOverwritten) {
  for (const char* name : {"reconstruct.json", "colmap.log", "database.db-wal", "images/a.png"}) {
    for (const std::string text : {"dear", "{\"complete\": [\"model\"]}"}) {
      write_bytes(scene() / name, text);
      EXPECT_THAT(error_of(job()), HasSubstr("choose another")) << name;
      EXPECT_EQ(read_bytes(scene() / name), text);
      EXPECT_EQ(std::distance(fs::directory_iterator(scene()), {}), 1) << name;
    }
    fs::remove_all(scene());
  }
}

/// A colmap that finds features and matches nothing.
constexpr const char* kUnluckyColmap =
    "#!/bin/sh\ncase \"$*\" in *\" -h\") exit 0;; feature*) exit 0;; esac\nexit 7\n";

TEST_F(FakeColmap, StartingOverRemovesOnlyWhatWePutThere) {
  install(kUnluckyColmap);
  error_of(job());
  EXPECT_FALSE(fs::exists(scene() / "images"));  // until it is whole
  const fs::path first_work = work();
  for (const char* name : {"mapping/notes.txt", ".gemsplat-abcde/mine.png", "a.png"})
    write_bytes(scene() / name, "dear");
  ColmapJob other = job();
  other.settings.mapper = Mapper::incremental;
  install(kGoodColmap);
  EXPECT_EQ(run_colmap(other, kSilent).registered, 3u);
  for (const char* name : {"mapping/notes.txt", ".gemsplat-abcde/mine.png", "a.png"})
    EXPECT_EQ(read_bytes(scene() / name), "dear") << name;
  EXPECT_FALSE(fs::exists(first_work));
  EXPECT_THAT(read_bytes(photos() / "a.png"), Not(testing::IsEmpty()));
}

TEST_F(FakeColmap, FoldersOfTheUsersAreNotReplaced) {
  for (const std::string name : {"sparse", "images"}) {
    install(kUnluckyColmap);
    error_of(job());
    write_bytes(scene() / name / "0/cameras.bin", "dear");
    install(kGoodColmap);
    EXPECT_THAT(error_of(job()), HasSubstr(name + " is there, and is not of this reconstruction"));
    EXPECT_EQ(read_bytes(scene() / name / "0/cameras.bin"), "dear");
    fs::remove_all(scene() / name);
    EXPECT_EQ(run_colmap(job(), kSilent).registered, 3u);
    fs::remove_all(scene());
  }
}

TEST_F(FakeColmap, WhatWasRemovedOfASceneIsMadeAgain) {
  run_colmap(job(), kSilent);
  fs::remove_all(scene() / "sparse");
  take_calls();
  EXPECT_EQ(run_colmap(job(), kSilent).registered, 3u);
  EXPECT_EQ(take_calls(), "mapper\nmapper\n");  // help first
  fs::remove_all(scene() / "sparse");
  fs::remove_all(scene() / "images");
  EXPECT_EQ(run_colmap(job(), kSilent).registered, 3u);
  EXPECT_TRUE(fs::exists(scene() / "images/a.png"));
}

TEST_F(FakeColmap, ASceneOfAnOlderVersionThatHasItsFeaturesIsFinished) {
  run_colmap(job(), kSilent);
  const Json whole = read_json(scene() / "reconstruct.json");
  const Json older = {{"made_of", whole.at("made_of")},
                      {"complete", {"features"}},
                      {"files", {{"database.db", ""}, {"images/a.png", "104 17"}}},
                      {"work", ""}};
  write_bytes(scene() / "reconstruct.json", older.dump());
  fs::remove_all(scene() / "sparse");
  EXPECT_EQ(run_colmap(job(), kSilent).registered, 3u);
  EXPECT_EQ(read_json(scene() / "reconstruct.json"), whole);
}

// The end of the program at each moment that the state is written: the same command goes on.
TEST_F(FakeColmap, AKillAtAnyWriteEndsInTheSameScene) {
  class KillAt : public WriteHook {
   public:
    explicit KillAt(int point) : left_(point) { set_write_hook(this); }
    void before(WritePoint, const fs::path&) override {
      if (--left_ == 0) ::kill(::getpid(), SIGKILL);
    }

   private:
    int left_;
  };
  const auto contents = [&] {
    std::map<std::string, std::string> files;
    for (const auto& entry : fs::recursive_directory_iterator(scene()))
      if (entry.is_regular_file() && entry.path().filename() != "colmap.log")
        files[entry.path().lexically_relative(scene()).string()] = read_bytes(entry.path());
    return files;
  };
  run_colmap(job(), kSilent);
  const auto whole = contents();
  int point = 0;
  for (bool is_killed = true; is_killed;) {
    fs::remove_all(scene());
    const pid_t child = ::fork();
    if (child == 0) {
      KillAt kill(point + 1);
      run_colmap(job(), kSilent);
      ::_exit(0);
    }
    is_killed = wait_for_child(child).signal == SIGKILL;
    ++point;
    EXPECT_EQ(run_colmap(job(), kSilent).registered, 3u) << point;
    EXPECT_EQ(contents(), whole) << point;
  }
  EXPECT_GT(point, 20);
}

TEST_F(FakeColmap, TwoAtATimeAreRefused) {
  const OutputLock lock = OutputLock::of_folder(scene());
  const pid_t child = ::fork();
  if (child == 0) {
    try {
      run_colmap(job(), kSilent);
    } catch (const Error& error) {
      ::_exit(std::string(error.what()).find("another process") == std::string::npos ? 2 : 1);
    }
    ::_exit(0);
  }
  EXPECT_EQ(wait_for_child(child).exit_code, 1);
  EXPECT_EQ(take_calls(), "");
}

TEST_F(FakeColmap, LargestModelBecomesTheFirst) {
  write_binary_model(path("large"), small_model(4));
  std::string script = kGoodColmap;
  script.replace(script.find(";;\nesac"), 2, "; cp -r \"$(dirname \"$0\")/large\" \"$2/1\";;");
  install(script);
  const Reconstruction result = run_colmap(job(), kSilent);
  EXPECT_EQ(result.registered, 4u);
  EXPECT_EQ(result.models, 2u);
  EXPECT_EQ(read_colmap_model(scene() / "sparse/1").images.size(), 3u);
}

TEST_F(FakeColmap, FewerThanThreePlacedPhotosAreNoScene) {
  write_binary_model(path("model"), small_model(2));
  EXPECT_THAT(error_of(job()), AllOf(HasSubstr("placed only 2 photo(s)"), HasSubstr("at least 3")));
  EXPECT_FALSE(fs::exists(scene() / "sparse"));
}

TEST_F(FakeColmap, MapperWithoutAModelGivesAdviceOnPhotos) {
  install(
      "#!/bin/sh\n[ $1 != mapper ] || { echo 'ERROR: failed to create sparse model'; exit 1; }\n");
  EXPECT_THAT(error_of(job()),
              AllOf(HasSubstr("could not place the cameras"), HasSubstr("take more photos")));
}

TEST_F(FakeColmap, MissingProgramNamesPackageAndFlag) {
  ColmapJob without = job();
  without.settings.colmap = "no-such-colmap";
  EXPECT_THAT(error_of(without), AllOf(HasSubstr("no-such-colmap"), HasSubstr("apt install colmap"),
                                       HasSubstr("--set reconstruct.colmap=PATH")));
  without.has_short_flags = true;
  EXPECT_THAT(error_of(without), HasSubstr("name it with --colmap PATH"));
}

TEST_F(FakeColmap, AdviceOnMatchingNamesAFlagThatTheVerbHas) {
  install(
      "#!/bin/sh\n[ $1 != mapper ] || { echo 'ERROR: failed to create sparse model'; exit 1; }\n");
  ColmapJob neighbors = job();
  neighbors.settings.matching = Matching::sequential;
  EXPECT_THAT(error_of(neighbors), HasSubstr("or try --set reconstruct.matching=exhaustive"));
  neighbors.has_short_flags = true;
  EXPECT_THAT(error_of(neighbors), HasSubstr("or try --matching exhaustive"));
}

TEST_F(FakeColmap, TheCheckThrowsBeforeAnythingIsWritten) {
  check_reconstruction(job());
  EXPECT_FALSE(fs::exists(scene()));
  ColmapJob without = job();
  without.settings.colmap = "no-such-colmap";
  EXPECT_THROW(check_reconstruction(without), Error);
  fs::remove(photos() / "a.png");
  fs::remove(photos() / "b.png");
  EXPECT_THROW(check_reconstruction(job()), Error);  // two photos
}

TEST_F(FakeColmap, SignalEndsTheProgramAndKeepsWhatIsComplete) {
  install(
      "#!/bin/sh\ncase \"$*\" in *\" -h\") exit 0;; exhaustive*) echo waiting; sleep 60;; esac\n");
  std::atomic<bool> is_matching = false, is_over = false;
  std::thread sender([&] {
    while (!is_matching && !is_over) std::this_thread::yield();
    std::this_thread::sleep_for(std::chrono::milliseconds(300));
    if (!is_over) ::kill(::getpid(), SIGINT);
  });
  const auto watch = [&](ColmapStage stage, std::int64_t, std::int64_t) {
    if (stage == ColmapStage::matches) is_matching = true;
  };
  const auto start = std::chrono::steady_clock::now();
  ExitCode code = ExitCode::done;
  try {
    run_colmap(job(), watch);
  } catch (const Error& error) {
    code = error.code();
  }
  is_over = true;
  sender.join();
  EXPECT_EQ(code, ExitCode::interrupted);
  EXPECT_LT(std::chrono::steady_clock::now() - start, std::chrono::seconds(50));
  EXPECT_THAT(read_bytes(scene() / "reconstruct.json"),
              AllOf(HasSubstr("\"features\""), Not(HasSubstr("\"matches\""))));
}

class VideoColmap : public FakeColmap {
 protected:
  void SetUp() override {
    if (!can_read_videos()) GTEST_SKIP() << "built without OpenCV";
    write_walk(folder() / "walk.avi", 12);
  }
  fs::path folder() const { return path("videos"); }
  static void write_walk(const fs::path& file, int count) {
    std::vector<Image8> frames;
    for (int i = 0; i < count; ++i) frames.push_back(random_photo(16, 12, std::uint64_t(i)));
    write_avi(file, frames);
  }
  ColmapJob video_job(int frames) const {
    ColmapJob result = job();
    result.photos = folder() / "walk.avi";
    result.settings.frames = frames;
    return result;
  }
  std::vector<std::string> images() const {
    std::vector<std::string> names;
    for (const auto& entry : fs::directory_iterator((work().empty() ? scene() : work()) / "images"))
      names.push_back(entry.path().filename().string());
    std::sort(names.begin(), names.end());
    return names;
  }
};

TEST_F(VideoColmap, FramesBecomeThePhotosAndNeighborsAreMatched) {
  std::int64_t last = 0, total = 0;
  run_colmap(video_job(6), [&](ColmapStage stage, std::int64_t done, std::int64_t all) {
    if (stage == ColmapStage::frames) last = done, total = all;
  });
  EXPECT_THAT(images(), SizeIs(6));
  EXPECT_THAT(images()[5], AllOf(HasSubstr("walk_0000"), HasSubstr(".png")));
  EXPECT_EQ(last, 12);
  EXPECT_EQ(total, 12);
  EXPECT_THAT(take_calls(), HasSubstr("sequential_matcher"));
  EXPECT_THAT(read_bytes(scene() / "colmap.log"), HasSubstr("--ImageReader.single_camera 1"));
}

TEST_F(VideoColmap, AShortFilmGivesAllOfItsFramesAndSaysSo) {
  CapturedLog logged;
  run_colmap(video_job(100), kSilent);
  EXPECT_THAT(logged.text(), AllOf(HasSubstr("all 12 frames of"), HasSubstr("--frames 3")));
  EXPECT_THAT(images(), SizeIs(12));
}

TEST_F(VideoColmap, FinishedSceneIsNotMadeAgainAndOtherFramesNeedForce) {
  run_colmap(video_job(6), kSilent);
  take_calls();
  const std::string photo = (scene() / "images" / images()[0]).string();
  const auto date = fs::last_write_time(photo);
  run_colmap(video_job(6), kSilent);
  EXPECT_EQ(take_calls(), "");
  EXPECT_EQ(fs::last_write_time(photo), date);
  EXPECT_THAT(error_of(video_job(5)), HasSubstr("holds a scene already"));
}

TEST_F(VideoColmap, FramesThatAreThereAreNotTakenAgain) {
  install("#!/bin/sh\nexit 3\n");
  error_of(video_job(6));
  EXPECT_THAT(images(), SizeIs(6));
  install(kGoodColmap);
  int frame_calls = 0;
  run_colmap(video_job(6), [&](ColmapStage stage, std::int64_t, std::int64_t) {
    frame_calls += stage == ColmapStage::frames;
  });
  EXPECT_EQ(frame_calls, 0);
}

TEST_F(VideoColmap, OtherFramesOfAnUnfinishedSceneReplaceThose) {
  install("#!/bin/sh\nexit 3\n");
  error_of(video_job(6));
  install(kGoodColmap);
  run_colmap(video_job(4), kSilent);
  EXPECT_THAT(images(), SizeIs(4));
}

TEST_F(VideoColmap, VideosOfAFolderShareTheFramesByTheirLength) {
  write_walk(folder() / "Stairs.mov", 36);
  write_walk(folder() / "walk.mkv", 12);  // AVI inside, as the reader finds out
  ColmapJob all = video_job(10);
  all.photos = folder();
  run_colmap(all, kSilent);
  const auto names = images();
  ASSERT_THAT(names, SizeIs(10));
  EXPECT_EQ(std::ranges::count_if(names, [](auto& name) { return name.starts_with("Stairs_"); }),
            6);
  EXPECT_EQ(std::ranges::count_if(names, [](auto& name) { return name.starts_with("walk.avi_"); }),
            2);
}

TEST_F(VideoColmap, DamagedVideoLeavesNoSceneThatLooksComplete) {
  const IgnoreForeignLeaks ignore;  // from OpenCV's backends
  write_bytes(folder() / "walk.avi", "no film");
  EXPECT_THAT(error_of(video_job(6)), AllOf(HasSubstr("walk.avi"), HasSubstr("ffmpeg")));
  EXPECT_FALSE(fs::exists(scene() / "sparse"));
}

class PhotoFolder : public FolderTest {};

TEST_F(PhotoFolder, VideosAreFoundWhereThereAreNoPhotos) {
  write_bytes(path("b.MP4"), "film");
  write_bytes(path("a.mov"), "film");
  write_bytes(path("notes.txt"), "");
  EXPECT_THAT(find_videos(folder()), ElementsAre(path("a.mov"), path("b.MP4")));
  EXPECT_THAT(find_videos(path("b.MP4")), ElementsAre(path("b.MP4")));
  EXPECT_TRUE(holds_only_photos(folder()));
  EXPECT_TRUE(holds_only_photos(path("b.MP4")));
  EXPECT_FALSE(holds_only_photos(path("notes.txt")));
  write_png(path("images/a.png"), plain_photo(4, 4, 9));
  EXPECT_THAT(find_videos(folder()), SizeIs(0));
}

TEST_F(PhotoFolder, VideoGetsAdvice) {
  write_bytes(path("walk.MP4"), "film");
  EXPECT_THAT(error_of([&] { find_photos(folder(), {}); }),
              HasSubstr("1 video(s): name one of them"));
}

TEST_F(PhotoFolder, NamesAreRelativeAndHiddenOrUnreadableFilesAreLeftOut) {
  write_png(path("images/b/1.png"), plain_photo(4, 4, 9));
  write_png(path("images/a.png"), plain_photo(4, 4, 9));
  write_png(path("images/.c.png"), plain_photo(4, 4, 9));
  write_bytes(path("images/d.png"), "no photo");
  std::vector<std::string> names;
  for (const PhotoFile& photo : find_photos(folder(), {})) names.push_back(photo.name);
  EXPECT_THAT(names, ElementsAre("a.png", "b/1.png"));
}

TEST_F(PhotoFolder, EveryFormatOfTrainingIsTakenAndAFileThatIsLeftOutIsNamed) {
  for (const char* name : {"a.jpg", "b.png"})
    write_png(path(name), plain_photo(4, 4, 9));  // decoders go by the content
  for (const char* name : {"a.heic", "c.HEIC", "d.webp", "e.bmp"})
    write_png(path(name), plain_photo(4, 4, 9));
  write_bytes(path("f.DNG"), "raw");
  std::vector<std::string> names;
  CapturedLog logged;
  for (const PhotoFile& photo : find_photos(folder(), {})) names.push_back(photo.name);
  const std::string& log = logged.text();
  EXPECT_THAT(names, ElementsAre("a.heic.jpg", "a.jpg", "b.png", "c.jpg", "d.png", "e.bmp"));
  EXPECT_THAT(log, HasSubstr("f.DNG"));
}

TEST_F(PhotoFolder, PhotosOfAFormatThatNothingReadsAreNamedWithTheWayOut) {
  write_bytes(path("f.DNG"), "raw");
  EXPECT_THAT(error_of([&] { find_photos(folder(), {}); }),
              AllOf(HasSubstr("f.DNG"), HasSubstr("export")));
  write_bytes(path("g.heic"), "no photo");
  EXPECT_THAT(error_of([&] { find_photos(folder(), {}); }), HasSubstr("g.heic"));
}

TEST_F(PhotoFolder, ArchivesAndCopiesAreNamed) {
  write_bytes(path("more.ZIP"), "packed");
  EXPECT_THAT(error_of([&] { find_photos(folder(), {}); }), HasSubstr("unpack more.ZIP"));
  write_png(path("a.png"), plain_photo(4, 4, 9));
  write_png(path("b.png"), plain_photo(4, 4, 8));
  {
    CapturedLog logged;
    EXPECT_THAT(find_photos(folder(), {}), SizeIs(2));
    EXPECT_THAT(logged.text(), AllOf(HasSubstr("1 archive is not opened"), HasSubstr("more.ZIP")));
    EXPECT_THAT(logged.text(), Not(HasSubstr("the same as another one")));
  }
  write_png(path("day2/c.png"), plain_photo(4, 4, 9));
  CapturedLog logged;
  EXPECT_THAT(find_photos(folder(), {}), SizeIs(3));
  EXPECT_THAT(logged.text(), HasSubstr("1 photo is the same as another one; take one of the two "
                                       "away: day2/c.png (a.png)"));
}

TEST_F(PhotoFolder, MasksAreNoPhotos) {
  write_png(path("a.png"), plain_photo(4, 4, 9));
  write_png(path("masks/a.png"), plain_photo(4, 4, 9));
  const std::vector<PhotoFile> photos = find_photos(folder(), {});
  ASSERT_EQ(photos.size(), 1u);
  EXPECT_EQ(photos[0].name, "a.png");
}

TEST_F(PhotoFolder, PhotosInSubFoldersAreABareScene) {
  write_png(path("day1/a.png"), plain_photo(4, 4, 9));
  write_png(path("day2/b.png"), plain_photo(4, 4, 9));
  EXPECT_TRUE(holds_only_photos(folder()));
  write_bytes(path("walk.mp4"), "film");
  EXPECT_TRUE(holds_only_photos(folder()));
  EXPECT_THAT(find_videos(folder()), SizeIs(0));  // a film is no reason to drop the photos
  EXPECT_THAT(find_photos(folder(), {}), SizeIs(2));
  write_bytes(path("other/deep/transforms_train.json"), "{}");
  EXPECT_FALSE(holds_only_photos(folder()));
}

TEST_F(PhotoFolder, PosesOfOtherProgramsAreSeenWithTheWayToColmap) {
  for (const auto& [name, content, program, way] :
       {std::tuple("walk.psx", "<document>", "Metashape", "Export Cameras"),
        std::tuple("poses/cams.csv", "#cameras 12\n", "RealityCapture", "Registration"),
        std::tuple("a.xmp", "<rdf:Description xcr:Version=\"3\">", "RealityCapture", "COLMAP")}) {
    std::filesystem::remove_all(folder());
    write_png(path("images/a.png"), plain_photo(4, 4, 9));
    write_bytes(path("notes.xml"), "<html>");
    write_bytes(path("list.csv"), "name,price\n");
    EXPECT_FALSE(find_foreign_cameras(folder())) << name;
    write_bytes(path(name), content);
    const auto found = find_foreign_cameras(folder());
    ASSERT_TRUE(found) << name;
    EXPECT_EQ(found->program, program);
    EXPECT_THAT(text_of(*found, folder()),
                AllOf(HasSubstr(name), HasSubstr(way), HasSubstr("gemsplat reconstruct")));
  }
}

TEST_F(PhotoFolder, FilesInPlaceOfAFolderGetTheSentenceThatHelps) {
  write_bytes(path("fox.zip"), "zip");
  EXPECT_THAT(error_of([&] { find_photos(path("fox.zip"), {}); }),
              HasSubstr("fox.zip is an archive: unpack it first"));
  EXPECT_FALSE(holds_only_photos(path("fox.zip")));
}

TEST_F(PhotoFolder, PhotosThatAreCutShortAndPanoramasAmongOthersAreLeftOutAndNamed) {
  write_png(path("a.png"), plain_photo(8, 4, 9));
  write_png(path("cut.png"), plain_photo(8, 4, 9));
  const std::string whole = read_bytes(path("cut.png"));
  write_bytes(path("cut.png"), whole.substr(0, whole.size() - 14));
  write_png(path("wide.png"), plain_photo(3200, 1600, 9));
  const std::vector<std::uint8_t> jpeg = encode_jpeg(Image8(16, 8, 3, 128), 90);
  std::string sphere(jpeg.begin(), jpeg.end());
  const std::string xmp = "http://ns.adobe.com/xap/1.0/" + std::string(1, '\0') +
                          "<GPano:ProjectionType>equirectangular</GPano:ProjectionType>";
  sphere.insert(2, std::string("\xff\xe1\0", 3) + char(2 + xmp.size()) + xmp);
  write_bytes(path("sphere.jpg"), sphere);
  CapturedLog logged;
  const std::vector<PhotoFile> photos = find_photos(folder(), {});
  const std::string& log = logged.text();
  ASSERT_THAT(photos, SizeIs(1));
  EXPECT_EQ(photos[0].name, "a.png");
  EXPECT_THAT(log, AllOf(HasSubstr("cut.png is cut short"), HasSubstr("2 panoramas are left out"),
                         HasSubstr("sphere.jpg, wide.png")));
}

/// Three panoramas, and a model of their views whose poses fit them but for one view.
class FakeColmapOfPanoramas : public FakeColmap {
 protected:
  static constexpr int kWidth = 3000;
  FakeColmapOfPanoramas() {
    fs::remove_all(photos());
    const Image8 panorama(kWidth, kWidth / 2, 3, 90);
    for (const char* name : {"a.png", "deep/b.png", "c.png"}) write_png(photos() / name, panorama);
    ColmapModel views;
    const double half = 477;
    for (std::uint32_t i = 0; i < 3 * kPanoramaViews; ++i) {
      const std::uint32_t camera = i / 3 + 1;
      views.cameras[camera] = {camera, CameraModel::pinhole, 954, 954, {half, half, half, half}};
      ColmapImage image{i + 1, fmt::format("{}/0000{}.jpg", i / 3, i % 3), camera};
      const double turn = double(i / 3) * std::numbers::pi / 3;  // to the right
      const Quat<double> view{std::cos(turn / 2), 0, -std::sin(turn / 2), 0};
      image.cam_from_world_rotation = product(view, rotation_of(i % 3));
      if (i == 4) image.cam_from_world_rotation = {1, 0, 0, 0};  // view 1 of panorama 1
      image.cam_from_world_translation =
          -multiply(rotation_matrix(image.cam_from_world_rotation), center_of(i % 3));
      image.observations = {{1, half, half}};  // its middle; all see one point
      views.images.push_back(image);
    }
    views.points = {{1, Vec3d(0, 0, 9), {1, 2, 3}, 0.5, 18}};
    write_binary_model(path("model"), views);
  }
  static Quat<double> rotation_of(std::uint32_t panorama) {
    return {std::cos(0.3 * panorama), 0, std::sin(0.3 * panorama), 0};
  }
  static Vec3d center_of(std::uint32_t panorama) { return {1.0 * panorama, 0.5, -2}; }
};

TEST_F(FakeColmapOfPanoramas, PlacesThemByTheirViews) {
  install(std::string(kGoodColmap) + R"sh(
[ "$1" = feature_extractor ] || exit 0
while [ "$1" != --image_list_path ]; do shift; done
cp "$2" "$(dirname "$0")/list"; cp "$(dirname "$2")/views/1/00002.jpg" "$(dirname "$0")/view.jpg"
)sh");
  const Reconstruction result = run_colmap(job(), kSilent);
  EXPECT_EQ(result.registered, 3u);
  EXPECT_THAT(read_bytes(path("list")),
              AllOf(HasSubstr("0/00000.jpg\n"), HasSubstr("5/00002.jpg\n")));
  EXPECT_EQ(read_photo_size(path("view.jpg")).width, 954);  // 3000 / pi
  EXPECT_THAT(read_bytes(scene() / "colmap.log"),
              HasSubstr("--ImageReader.camera_params 477,477,477,477"));
  const ColmapModel model = read_colmap_model(scene() / "sparse" / "0", Tracks::read);
  ASSERT_THAT(model.images, SizeIs(3));
  EXPECT_EQ(model.cameras.begin()->second.model, CameraModel::equirectangular);
  EXPECT_EQ(model.images[2].name, "deep/b.png");
  for (std::uint32_t i = 0; i < 3; ++i) {
    const ColmapImage& image = model.images[i];
    const Mat3<double> R = rotation_matrix(image.cam_from_world_rotation);
    const Vec3d away =
        multiply(R, center_of(i)) + image.cam_from_world_translation;  // 0: at its place
    EXPECT_LT(inner(away, away), 1e-12) << i;
    const Vec3d turned = R.row2 - rotation_matrix(rotation_of(i)).row2;
    EXPECT_LT(inner(turned, turned), 1e-12) << i;
    ASSERT_THAT(image.observations, SizeIs(1));
    EXPECT_NEAR(image.observations[0].x, kWidth / 2, 1e-6);  // of view 0, which looks ahead
    EXPECT_NEAR(image.observations[0].y, kWidth / 4, 1e-6);
  }
  EXPECT_FALSE(fs::exists(scene() / "views"));
  EXPECT_TRUE(fs::exists(scene() / "images" / "deep" / "b.png"));
}

// New versions are told of the rig before they match, old ones after they have placed the views.
TEST_F(FakeColmapOfPanoramas, EveryVersionHearsOfTheRig) {
  const auto colmap_with = [&](const std::string& command) {
    install(
        std::string(kGoodColmap)
            .insert(std::strlen("#!/bin/sh\n"), "[ \"$1\" = help ] && echo '  " + command + "'\n") +
        R"sh(
case "$1" in rig_*)
  all="$*"
  while [ "$1" != --rig_config_path ]; do [ "$1" = --output_path ] && out=$2; shift; done
  cp "$2" "$(dirname "$0")/rig.json"
  case "$all" in *--input_path*) cp "$(dirname "$0")/model/"* "$out";; esac
esac
)sh");
    ColmapJob job = this->job();
    job.force = true;
    run_colmap(job, kSilent);
    return Json::parse(read_bytes(path("rig.json")))[0];
  };
  const Json of_new = colmap_with("rig_configurator");
  ASSERT_EQ(of_new.at("cameras").size(), std::size_t(kPanoramaViews));
  EXPECT_EQ(of_new.at("cameras")[0].at("ref_sensor"), true);
  EXPECT_NEAR(of_new.at("cameras")[1].at("cam_from_rig_rotation")[2].get<double>(), -0.5, 1e-12);
  EXPECT_THAT(take_calls(), HasSubstr("rig_configurator\nexhaustive_matcher"));
  const Json of_old = colmap_with("rig_bundle_adjuster");
  EXPECT_EQ(of_old.at("cameras")[3].at("camera_id"), 4);
  EXPECT_THAT(take_calls(), HasSubstr("mapper\nhelp\nhelp\nrig_bundle_adjuster"));
}

TEST_F(PhotoFolder, OnlyPhotosMeansNoPosesNearby) {
  write_png(path("images/a.png"), plain_photo(4, 4, 9));
  EXPECT_TRUE(holds_only_photos(folder()));
  EXPECT_TRUE(holds_only_photos(path("images")));
  write_bytes(path("transforms.json"), "{}");
  EXPECT_FALSE(holds_only_photos(folder()));
  fs::remove(path("transforms.json"));
  write_binary_model(path("sparse/3"), small_model(1));
  EXPECT_FALSE(holds_only_photos(folder()));
  EXPECT_FALSE(holds_only_photos(path("images")));
}

TEST(ColmapLog, CountsAreReadFromOldAndNewLines) {
  const auto count = [](std::string_view line) {
    const auto found = colmap_count(line);
    return found ? std::pair(found->done, found->total)
                 : std::pair<std::int64_t, std::int64_t>(-1, -1);
  };
  using Pair = std::pair<std::int64_t, std::int64_t>;
  EXPECT_EQ(count("Processed file [3/12]"), Pair(3, 12));
  EXPECT_EQ(count("I20250101 feature_extraction.cc:254] Processed file [3/12]"), Pair(3, 12));
  EXPECT_EQ(count("Matching block [2/3, 1/3] in 2.8s"), Pair(4, 9));
  EXPECT_EQ(count("Matching image [7/300] in 0.1s"), Pair(7, 300));
  EXPECT_EQ(count("Registering image #10 (3)"), Pair(3, 0));
  EXPECT_EQ(count("Registering image #10 (num_reg_frames=3)"), Pair(3, 0));
  EXPECT_EQ(count("  Name:            photo [3/12].jpg"), Pair(-1, -1));
}

}  // namespace
}  // namespace gs
