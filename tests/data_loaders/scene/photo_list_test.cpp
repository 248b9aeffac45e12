// SPDX-License-Identifier: Apache-2.0
// Runs on some photos of a scene: dataset.photo_list.
#include "data_loaders/scene/photo_list.h"

#include <gmock/gmock.h>

#include <algorithm>

#include "data_loaders/photos/encode/encode_png.h"
#include "tests/support/load_scene.h"

namespace gs {
namespace {

using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;

std::vector<bool> in_list(const std::string& text, const std::vector<std::string>& names) {
  const TempFolder temp;
  write_bytes(temp.path() / "list.txt", text);
  return photos_in_list(temp.path() / "list.txt", names);
}

TEST(PhotoList, NamesPhotosWithAndWithoutEndingAndWholeFolders) {
  const std::vector<std::string> names = {"a.jpg", "b.jpg", "left/1.jpg", "left/2/x.jpg",
                                          "lefty.jpg"};
  EXPECT_THAT(in_list("# a comment\r\n\nb\r\nleft/\n", names),
              ElementsAre(false, true, true, true, false));
  EXPECT_THAT(in_list("a.jpg\nleft/2/x.jpg", names), ElementsAre(true, false, false, true, false));
}

TEST(PhotoList, ALineThatMeansNoPhotoAndAnEmptyListAreRefused) {
  EXPECT_THAT(error_of([] {
                in_list("a\nc.jpg\n", {"a.jpg", "b.jpg"});
              }),
              AllOf(HasSubstr("c.jpg"), HasSubstr("list.txt"), HasSubstr("remove the line")));
  EXPECT_THAT(error_of([] { in_list("# nothing\n", {"a.jpg"}); }), HasSubstr("holds no name"));
  EXPECT_THAT(error_of([] { photos_in_list("/nowhere/list.txt", {}); }),
              HasSubstr("/nowhere/list.txt"));
}

TEST(PhotoList, IsReadBackAsItWasWritten) {
  const TempFolder temp;
  write_photo_list(temp.path() / "list.txt", {"b.jpg", "with blank.jpg"});
  EXPECT_THAT(photos_in_list(temp.path() / "list.txt", {"a.jpg", "b.jpg", "with blank.jpg"}),
              ElementsAre(false, true, true));
}

/// Five images; a and b show point 0 of the model, d shows both.
class ListedScene : public SceneTest {
 protected:
  explicit ListedScene(bool with_tracks = true) : model_(small_model(5)) {
    const auto see = [&](int image, int point) {
      model_.images[image].observations.push_back({model_.points[point].id, 3, 4});
    };
    if (with_tracks) see(0, 0), see(1, 0), see(3, 0), see(3, 1);
    write(model_);
  }
  DatasetConfig listed(const std::string& names) {
    write_bytes(path("list.txt"), names);
    DatasetConfig dataset = dataset_at(folder());
    dataset.photo_list = path("list.txt").string();
    return dataset;
  }

  ColmapModel model_;
};

TEST_F(ListedScene, HasTheListedPhotosAndThePointsThatTheyShow) {
  const Scene scene = load_scene(listed("a\nb\n"));
  EXPECT_THAT(names_of(scene.train_views), ElementsAre("a.png", "b.png"));
  EXPECT_EQ(scene.train_views[1].photo.pixels, plain_photo(12, 8, 10).pixels);
  ASSERT_EQ(scene.points.size(), 1u);
  EXPECT_EQ(scene.points[0].position, Vec3f(model_.points[0].position));
  EXPECT_EQ(load_scene(listed("d\n")).points.size(), 2u);
  EXPECT_EQ(load_scene(listed("c\n")).points.size(), 0u);
}

TEST_F(ListedScene, HoldsOutTheSamePhotosAsTheWholeScene) {
  DatasetConfig dataset = listed("b\nc\nd\n");
  dataset.eval = true;
  dataset.test_every = 3;  // a and d
  const Scene scene = load_scene(dataset);
  EXPECT_THAT(names_of(scene.train_views), ElementsAre("b.png", "c.png"));
  EXPECT_THAT(names_of(scene.test_views), ElementsAre("d.png"));
  dataset = listed("d\n");
  dataset.eval = true;
  dataset.test_every = 3;
  EXPECT_THAT(error_of(dataset), AllOf(HasSubstr("no view is left"), HasSubstr("list.txt")));
}

TEST_F(ListedScene, OnlyListedPhotosAreDecoded) {
  const std::filesystem::path file = image("c.png");
  Image8 noise = plain_photo(12, 8, 0);
  for (std::size_t i = 0; i < noise.pixels.size(); ++i) noise.pixels[i] = std::uint8_t(37 * i * i);
  write_png(file, noise);
  std::string bytes = read_bytes(file);
  std::fill(bytes.end() - 100, bytes.end() - 16, '\0');  // pixels; header and end stay
  write_bytes(file, bytes);
  EXPECT_EQ(load_scene(listed("a\nb\n")).train_views.size(), 2u);
  EXPECT_THAT(error_of(listed("a\nc\n")), HasSubstr("c.png"));
}

TEST_F(ListedScene, TheOutlineSaysWhoShowsWhat) {
  const SceneOutline whole = outline_scene(dataset());
  EXPECT_EQ(whole.names.size(), 5u);
  EXPECT_EQ(whole.cameras[2].position(), Vec3f(2, 0, 0));
  EXPECT_THAT(whole.shown[0], ElementsAre(0u));
  EXPECT_THAT(whole.shown[3], ElementsAre(0u, 1u));
  const SceneOutline part = outline_scene(listed("b\nd\n"));
  EXPECT_THAT(part.names, ElementsAre("b.png", "d.png"));
  EXPECT_THAT(part.shown[1], ElementsAre(0u, 1u));
}

class ListedSceneWithoutTracks : public ListedScene {
 protected:
  ListedSceneWithoutTracks() : ListedScene(false) {}
};

TEST_F(ListedSceneWithoutTracks, KeepsThePointsInThePicturesOfListedPhotos) {
  // Point 0, at (1, 2, 3), is below all pictures, which are 8 pixels high at a focal length of 11.
  // Point 1, at (-1, 0.5, 4), is in those of the cameras at x = 0 and 1, and left of the others.
  EXPECT_EQ(load_scene(listed("a\n")).points.size(), 1u);
  EXPECT_EQ(load_scene(listed("e\n")).points.size(), 0u);
}

}  // namespace
}  // namespace gs
