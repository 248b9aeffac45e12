// SPDX-License-Identifier: Apache-2.0
// Photos that a person turns or masks in the studio: what jobs get of them, and that the photos
// themselves stay as they are. studio_photos_test.mjs drives the page.
#include <gmock/gmock.h>

#include <chrono>
#include <limits>
#include <thread>

#include "data_loaders/photos/encode/encode_png.h"
#include "data_loaders/photos/orientation.h"
#include "gs_app/studio/masks.h"
#include "gs_app/studio/studio_server.h"
#include "gs_core/error.h"
#include "gs_core/system/files/access.h"
#include "gs_core/system/processes/signals.h"
#include "gs_core/system/text/read_json.h"
#include "tests/support/error_of.h"
#include "tests/support/exif_photo.h"
#include "tests/support/temp_folder.h"
#include "tests/support/tiny_photos.h"

namespace gs {
namespace {

namespace fs = std::filesystem;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;
using ::testing::Pair;

const std::string kCourtyard = std::string(GS_SOURCE_DIR) + "/examples/courtyard";

std::string text_of(const std::vector<std::uint8_t>& bytes) { return {bytes.begin(), bytes.end()}; }

// White, but for a black rectangle in the corner that is seen at the left above.
Image8 corner_mask(int width, int height) {
  Image8 mask(width, height, 1, 255);
  for (int y = 0; y < height / 2; ++y)
    for (int x = 0; x < width / 2; ++x) mask.at(x, y, 0) = 0;
  return mask;
}
std::string corner_png(int width, int height) {
  return text_of(encode_png(corner_mask(width, height)));
}

// A project with a photo that EXIF turns, 16 x 8 and seen as 8 x 16, and a PNG of 6 x 4.
class StudioPhotos : public ::testing::Test {
 protected:
  StudioPhotos() {
    project_.folder = folder_.path() / "fox";
    project_.name = "fox";
    write_bytes(photo("a.jpg"), {reinterpret_cast<const char*>(kTurnedJpeg), sizeof kTurnedJpeg});
    Image8 colors(6, 4, 3);
    for (std::size_t i = 0; i < colors.pixels.size(); ++i) colors.pixels[i] = std::uint8_t(3 * i);
    write_png(photo("day 1/b.png"), colors);
    write_bytes(photo("c.jpg"), exposed_photo(16, 8, {0.008, 2.8, 400}));
    write_bytes(photo("d.jpg"), exposed_photo(16, 8, {0.004, 2.8, 400}));
    write_project(project_);
    for (const std::string& name : photos_of(project_)) before_[name] = read_bytes(photo(name));
  }
  ~StudioPhotos() override {
    for (const auto& [name, bytes] : before_) EXPECT_EQ(read_bytes(photo(name)), bytes) << name;
  }

  fs::path photo(const std::string& name) const { return project_.folder / "input" / name; }
  // A scene that `reconstruct` has made of the project's photos in job 2.
  void write_scene(const std::vector<std::string>& images) {
    const fs::path scene = project_.folder / "scene-2", model = scene / "sparse/0";
    std::string poses;
    for (std::size_t i = 0; i < images.size(); ++i) {
      poses += std::to_string(i + 1) + " 1 0 0 0 0 0 0 1 " + images[i] + "\n\n";
      write_bytes(scene / "images" / images[i], "photo");
    }
    write_bytes(scene / "reconstruct.json", "{}");
    write_bytes(model / "cameras.txt", "1 PINHOLE 16 8 20 20 8 4\n");
    write_bytes(model / "images.txt", poses);
    write_bytes(model / "points3D.txt", "");
    project_.jobs.push_back({.id = 2,
                             .words = {"reconstruct", "chosen-2", "-o", "scene-2"},
                             .state = JobState::done,
                             .turned = project_.turned});
  }
  std::string masks(int job) {
    return masks_for_job(project_, "scene-2", photos_of_scene(project_, "scene-2"), job);
  }

  TempFolder folder_;
  Project project_;
  std::map<std::string, std::string> before_;
};

TEST_F(StudioPhotos, OfOlderProjectsAreNotTurned) {
  write_bytes(project_.folder / "project.json",
              R"({"version": 1, "name": "fox", "photos": "", "left_out": ["a.jpg"], "model": "",
                  "jobs": [{"id": 1, "words": ["doctor"], "state": "done", "message": "",
                            "began": 0, "ended": 0}]})");
  Project old = read_project(project_.folder);
  EXPECT_THAT(old.turned, IsEmpty());
  EXPECT_THAT(old.jobs.at(0).turned, IsEmpty());
  old.turned = old.jobs[0].turned = {{"a.jpg", 90}};
  write_project(old);
  EXPECT_THAT(read_project(project_.folder).turned, ElementsAre(Pair("a.jpg", 90)));
  EXPECT_THAT(read_project(project_.folder).jobs[0].turned, ElementsAre(Pair("a.jpg", 90)));
}

TEST_F(StudioPhotos, AreChosenAsLinksAndTurnedOnesAsUprightCopies) {
  project_.turned = {{"a.jpg", 90}, {"day 1/b.png", 270}, {"d.jpg", 180}, {"gone.jpg", 90}};
  project_.left_out = {"c.jpg"};
  make_turned_copies(project_);
  choose_photos(project_, 7);
  const fs::path chosen = project_.folder / "chosen-7";
  EXPECT_FALSE(is_there(chosen / "c.jpg"));
  const Image8 a = read_photo(chosen / "a.jpg");  // red above blue, and then turned to the right
  ASSERT_EQ(a.width, 16);
  EXPECT_GT(a.at(13, 4, 0), 200);
  EXPECT_GT(a.at(2, 4, 2), 200);
  EXPECT_EQ(read_photo_orientation(chosen / "a.jpg"), 1);
  EXPECT_EQ(read_photo(chosen / "day 1/b.png").pixels,
            turned(read_photo(photo("day 1/b.png")), 270).pixels);
  EXPECT_EQ(read_exposure_stops(chosen / "d.jpg"), read_exposure_stops(photo("d.jpg")));

  project_.turned.erase("day 1/b.png");
  choose_photos(project_, 8);
  EXPECT_TRUE(fs::equivalent(project_.folder / "chosen-8/day 1/b.png", photo("day 1/b.png")));
  EXPECT_EQ(read_photo(chosen / "day 1/b.png").width, 4);  // of the job before
}

TEST_F(StudioPhotos, ThatHaveChangedAreTurnedAgain) {
  project_.turned = {{"c.jpg", 180}};
  choose_photos(project_, 1);
  before_["c.jpg"] = exposed_photo(24, 8, {0.008, 2.8, 400});
  write_bytes(photo("c.jpg"), before_["c.jpg"]);
  fs::last_write_time(photo("c.jpg"), fs::file_time_type::clock::now() - std::chrono::hours(9));
  choose_photos(project_, 2);
  EXPECT_EQ(read_photo_size(project_.folder / "chosen-2/c.jpg").width, 24);
  EXPECT_EQ(read_photo_size(project_.folder / "chosen-1/c.jpg").width, 16);
}

TEST_F(StudioPhotos, KeepMasksAsTheirPixelsAreStored) {
  Studio studio(folder_.path());
  studio.paint("fox", "a.jpg", 90, corner_png(32, 16));
  const Image8 stored = read_photo(project_.folder / "masks/a.jpg.png");
  ASSERT_EQ(stored.width, 32);
  // Upright by a turn to the right and turned to the right again: what is above at the left was below
  // at the right.
  EXPECT_EQ(stored.at(31, 15, 0), 0);
  EXPECT_EQ(stored.at(0, 0, 0), 255);
  EXPECT_EQ(mask_as_seen(project_, "a.jpg", 90).pixels, corner_mask(32, 16).pixels);
  EXPECT_EQ(mask_as_seen(project_, "a.jpg", 0).width, 16);
  EXPECT_THAT(studio.details("fox")["masked"].items().begin().key(), "a.jpg");

  const std::string white = text_of(encode_png(Image8(32, 16, 1, 255)));
  studio.paint("fox", "a.jpg", 270, white);
  EXPECT_FALSE(is_there(project_.folder / "masks/a.jpg.png"));
  studio.paint("fox", "d.jpg", 0, white);  // which has none
  EXPECT_THAT(studio.details("fox")["masked"], IsEmpty());
}

TEST_F(StudioPhotos, TakeNoMaskThatIsNone) {
  const std::string good = corner_png(16, 8);
  std::string huge = good, endless = corner_png(1025, 512), damaged = good.substr(0, 40);
  huge.replace(16, 8, "\x00\x00\x75\x30\x00\x00\x3a\x98", 8);  // 30000 x 15000
  const std::string jpeg = read_bytes(photo("d.jpg"));
  Studio studio(folder_.path());
  StudioServer server(studio, "secret");
  const auto answer = [&](const std::string& name, const std::string& body,
                          const std::string& turn) {
    HttpRequest request;
    request.method = "POST";
    request.path = "/secret/p/fox/mask";
    request.query = {{"name", name}, {"turn", turn}};
    request.body = body;
    return server.answer(request);
  };
  for (const auto& body : {std::string(), std::string("PNG"), huge, endless, damaged, jpeg,
                           corner_png(16, 16), corner_png(8, 16)}) {
    const HttpAnswer said = answer("d.jpg", body, "0");
    EXPECT_EQ(said.status, 400);
    EXPECT_THAT(*said.body, Not(HasSubstr("\n"))) << *said.body;
  }
  for (const char* name :
       {"", "e.jpg", "../a.jpg", "/etc/passwd", "masks/a.jpg", ".a.jpg", "day 1"})
    EXPECT_EQ(answer(name, good, "0").status, 400) << name;
  for (const char* turn : {"45", "360", "-90", "x", "", "99999999999999999999"})
    EXPECT_EQ(answer("d.jpg", good, turn).status, 400) << turn;
  EXPECT_EQ(answer("d.jpg", corner_png(16, 8), "90").status, 400);  // another shape when turned
  EXPECT_THAT(entries_of(project_.folder / "masks"), IsEmpty());
  EXPECT_EQ(answer("d.jpg", good, "0").status, 200);
  EXPECT_EQ(answer("day 1/b.png", corner_png(512, 768), "90").status, 200);
  EXPECT_TRUE(is_file(project_.folder / "masks/day 1/b.png.png"));
  for (const char* turned : {R"({"a.jpg": 45})", R"({"a.jpg": -90})", R"({"a.jpg": "90"})", "7"})
    EXPECT_THROW(studio.change("fox", {{"turned", Json::parse(turned)}}), std::exception);
  studio.change("fox", {{"turned", {{"a.jpg", 0}, {"d.jpg", 270}}}});
  EXPECT_THAT(read_project(project_.folder).turned, ElementsAre(Pair("d.jpg", 270)));
}

TEST_F(StudioPhotos, AreMaskedAsTheyLieInTheScene) {
  project_.turned = {{"d.jpg", 180}};
  write_scene({"a.jpg", "b.png", "d.jpg"});
  EXPECT_EQ(masks(3), "");
  keep_mask(project_, "a.jpg", corner_mask(32, 16));  // as stored
  keep_mask(project_, "d.jpg", corner_mask(16, 8));
  project_.turned.clear();  // after the cameras were found
  EXPECT_EQ(masks(3), "../masks-3");
  const fs::path folder = project_.folder / "masks-3";
  EXPECT_EQ(entries_of(folder).size(), 2u);
  EXPECT_EQ(read_photo(folder / "a.jpg.png").width, 16);  // upright
  EXPECT_EQ(read_photo(folder / "a.jpg.png").at(15, 0, 0), 0);
  EXPECT_EQ(read_photo(folder / "d.jpg.png").at(15, 7, 0), 0);

  keep_mask(project_, "a.jpg", {});
  EXPECT_EQ(masks(4), "../masks-4");
  EXPECT_EQ(entries_of(project_.folder / "masks-4").size(), 1u);
  EXPECT_EQ(entries_of(folder).size(), 2u);  // those of the job before stay
}

TEST_F(StudioPhotos, AreKnownByTheNamesOfTheirCopies) {
  write_scene({"a.png", "d.jpg", "frame_1.jpg"});
  const std::vector<ScenePhoto> photos = photos_of_scene(project_, "scene-2");
  ASSERT_EQ(photos.size(), 3u);
  EXPECT_EQ(photos[0].photo, "a.jpg");
  EXPECT_EQ(photos[1].photo, "d.jpg");
  EXPECT_EQ(photos[2].photo, "");
  project_.left_out = {"a.jpg"};
  EXPECT_TRUE(write_chosen_list(project_, photos));
  EXPECT_EQ(read_bytes(project_.folder / "photos.txt"), "d.jpg\nframe_1.jpg\n");
}

TEST_F(StudioPhotos, WithMasksBesideThemGetNoOthers) {
  write_png(photo("masks/a.jpg.png"), corner_mask(16, 8));
  write_scene({"a.jpg", "d.jpg"});
  Studio studio(folder_.path());
  EXPECT_TRUE(studio.details("fox")["has_own_masks"]);
  EXPECT_EQ(studio.details("fox")["pictures"].size(), 4u);
  EXPECT_THAT(error_of([&] { studio.paint("fox", "a.jpg", 0, corner_png(16, 8)); }),
              HasSubstr("of their own"));
  EXPECT_EQ(masks(3), "../input/masks");
}

TEST(StudioMasks, AreWordsOfTrainingAndDoctor) {
  set_program_to_start(GS_PROGRAM);
  const TempFolder folder;
  Studio studio(folder.path());
  const std::string id = studio.create("court", kCourtyard);
  studio.paint(id, "view_003.jpg", 0, corner_png(480, 360));
  const auto start = [&](std::vector<std::string> words) {
    studio.start(id, std::move(words));
    return read_project(folder.path() / id).jobs.back().words;
  };
  const std::string masks = (folder.path() / id / "masks-").string();
  EXPECT_THAT(start({"doctor", kCourtyard}),
              ElementsAre("doctor", kCourtyard, "--masks", masks + "1"));
  EXPECT_EQ(start({"train", kCourtyard, "-o", "run-{id}", "-c", "cpu_tiny", "-r", "48",
                   "--iterations", "2"})
                .back(),
            masks + "2");
  EXPECT_EQ(start({"train", kCourtyard, "--masks", "none", "--dry-run"}).back(), "--dry-run");
  const auto state = [&](int job) { return studio.said(id, job)["job"]["state"]; };
  for (int i = 0; i < 600 && state(2) != "done" && state(2) != "failed"; ++i)
    std::this_thread::sleep_for(std::chrono::milliseconds(100));
  EXPECT_EQ(state(2), "done") << studio.said(id, 2);
  EXPECT_THAT(studio.said(id, 1)["outcome"].dump(), HasSubstr("1 of 40 photos have a mask"));
}

}  // namespace
}  // namespace gs
