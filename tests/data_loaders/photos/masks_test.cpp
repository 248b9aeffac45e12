// SPDX-License-Identifier: Apache-2.0
// Masks and alpha, from their files to the views that are trained.
#include "data_loaders/scene/view_picture.h"

#include <gmock/gmock.h>

#include "data_loaders/doctor/doctor.h"
#include "data_loaders/lenses/undistort.h"
#include "data_loaders/photos/encode/encode_png.h"
#include "data_loaders/scene/load_scene.h"
#include "tests/support/load_scene.h"
#include "tests/support/tiny_photos.h"

namespace gs {
namespace {

using testing::AllOf;
using testing::HasSubstr;
using testing::Not;

constexpr int kWidth = 12, kHeight = 8;  // of small_model()'s photos

/// White on the left `white` columns, black on the others.
Image8 left_mask(int white, int width = kWidth, int height = kHeight) {
  Image8 mask(width, height, 1);
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < white; ++x) mask.at(x, y, 0) = 255;
  return mask;
}

/// A photo with alpha.
Image8 with_alpha(const Image8& photo, const Image8& alpha) {
  Image8 image(photo.width, photo.height, 4);
  for (std::size_t i = 0; i < alpha.pixels.size(); ++i) {
    for (int c = 0; c < 3; ++c) image.pixels[4 * i + c] = photo.pixels[3 * i + c];
    image.pixels[4 * i + 3] = alpha.pixels[i];
  }
  return image;
}

class Masks : public SceneTest {
 protected:
  /// A scene whose photos have these names in the model and as files.
  void write_photos(const std::vector<std::string>& names) {
    ColmapModel model = small_model(int(names.size()));
    for (std::size_t i = 0; i < names.size(); ++i) model.images[i].name = names[i];
    write_binary_model(folder() / "sparse/0", model);
    for (const std::string& name : names) {
      write_png(folder() / "images/photo.png", plain_photo(kWidth, kHeight, 100));
      std::filesystem::create_directories((folder() / "images" / name).parent_path());
      std::filesystem::rename(folder() / "images/photo.png", folder() / "images" / name);
    }
  }
  void write_mask(const std::string& name, const Image8& mask = left_mask(4)) {
    write_png(folder() / "mask.png", mask);
    std::filesystem::create_directories((folder() / name).parent_path());
    std::filesystem::rename(folder() / "mask.png", folder() / name);
  }
  View view(const DatasetConfig& dataset, std::size_t i = 0) {
    return load_scene(dataset).train_views.at(i);
  }
};

TEST_F(Masks, OfEveryNamingAreFound) {
  for (const char* name : {"a/b.jpg.png", "a/b.jpg", "a/b.png", "a/b.mask.png", "a/b_mask.png",
                           "a/b.jpg.mask.png", "a/b.tif"}) {
    SCOPED_TRACE(name);
    write_photos({"a/b.jpg", "c.jpg"});
    std::filesystem::remove_all(folder() / "masks");
    write_mask("masks/" + std::string(name));
    EXPECT_EQ(view(dataset()).mask.pixels, left_mask(4).pixels);
    EXPECT_TRUE(view(dataset(), 1).mask.empty());
  }
}

TEST_F(Masks, AreTakenInTheOrderOfTheirNamings) {
  write_photos({"b.jpg"});
  const char* names[] = {"b_mask.png", "b.mask.png", "b.png", "b.jpg", "b.jpg.png"};
  for (int i = 0; i < 5; ++i) {
    write_mask("masks/" + std::string(names[i]), left_mask(1 + i));
    EXPECT_EQ(view(dataset()).mask.pixels, left_mask(1 + i).pixels) << names[i];
  }
}

TEST_F(Masks, OfAnotherPhotosNameAreThatPhotos) {
  write_photos({"b.jpg", "b.png"});
  write_mask("masks/b.png");
  EXPECT_TRUE(view(dataset(), 0).mask.empty());
  EXPECT_EQ(view(dataset(), 1).mask.pixels, left_mask(4).pixels);
}

TEST_F(Masks, ThatCouldBeEitherOfTwoAreRefused) {
  write_photos({"b.jpg"});
  write_mask("masks/b.bmp");
  write_mask("masks/b.tif");
  EXPECT_THAT(error(),
              AllOf(HasSubstr("'b.jpg'"), HasSubstr("b.bmp and b.tif"), HasSubstr("leave one")));
  write_mask("masks/b.png");
  EXPECT_EQ(view(dataset()).mask.pixels, left_mask(4).pixels);
}

TEST_F(Masks, MayLieBesideThePhotos) {
  write_photos({"b.png", "c.png"});
  write_mask("images/b.mask.png");
  write_mask("images/c_mask.png", left_mask(5));
  DatasetConfig beside = dataset();
  EXPECT_TRUE(view(beside).mask.empty());
  beside.masks = "images";
  EXPECT_EQ(view(beside, 0).mask.pixels, left_mask(4).pixels);
  EXPECT_EQ(view(beside, 1).mask.pixels, left_mask(5).pixels);
}

TEST_F(Masks, OfAPhotoThatWasRenamedAreFoundByItsFilesName) {
  write_photos({"b.jpg"});
  std::filesystem::rename(folder() / "images/b.jpg", folder() / "images/B.PNG");
  write_mask("masks/B.PNG.png");
  EXPECT_EQ(view(dataset()).mask.pixels, left_mask(4).pixels);
}

TEST_F(Masks, MayBeInAnotherFolderOrInNone) {
  write_photos({"b.jpg"});
  write_mask("masks/b.png");
  write_mask("other/b.png", left_mask(7));
  DatasetConfig named = dataset();
  named.masks = "other";
  EXPECT_EQ(view(named).mask.pixels, left_mask(7).pixels);
  named.masks = (folder() / "other").string();
  EXPECT_EQ(view(named).mask.pixels, left_mask(7).pixels);
  named.masks = "none";
  EXPECT_TRUE(view(named).mask.empty());
  named.masks = "nowhere";
  EXPECT_THAT(error_of(named), AllOf(HasSubstr("nowhere"), HasSubstr("--masks none")));
}

TEST_F(Masks, ThatAreNobodysAreRefusedWhereNamedAndToldWhereFound) {
  write_photos({"b.jpg"});
  write_mask("masks/other.png");
  EXPECT_THAT(log_of(dataset()),
              AllOf(HasSubstr("none of the 1 pictures"), HasSubstr("b.jpg.png")));
  DatasetConfig named = dataset();
  named.masks = "masks";
  EXPECT_THAT(error_of(named), AllOf(HasSubstr("none of the 1 pictures"), HasSubstr("b.jpg.png")));
}

TEST_F(Masks, MissingOnesAreCountedAndCoverageIsTold) {
  write_photos({"b.jpg", "c.jpg", "d.jpg"});
  write_mask("masks/c.png", left_mask(3));
  EXPECT_THAT(log_of(dataset()),
              AllOf(HasSubstr("2 of 3 photos have no mask"), HasSubstr("b.jpg, ..."),
                    HasSubstr("1 of 3 photos are masked: 25.0 % of their pixels train")));
}

TEST_F(Masks, InvertedSwapBlackAndWhite) {
  write_photos({"b.jpg"});
  Image8 mask = left_mask(4), inverted = mask;
  mask.at(6, 3, 0) = 100;
  for (std::size_t i = 0; i < mask.pixels.size(); ++i)
    inverted.pixels[i] = std::uint8_t(255 - mask.pixels[i]);
  write_mask("masks/b.png", mask);
  EXPECT_EQ(view(dataset()).mask.pixels, mask.pixels);  // gray is kept
  DatasetConfig turned = dataset();
  turned.invert_masks = true;
  EXPECT_EQ(view(turned).mask.pixels, inverted.pixels);
}

TEST_F(Masks, OfOnesAreTakenAsWhiteAndColorsByTheirBrightestChannel) {
  write_photos({"b.jpg"});
  Image8 ones = left_mask(4);
  for (std::uint8_t& value : ones.pixels) value = value ? 1 : 0;
  write_mask("masks/b.png", ones);
  EXPECT_EQ(view(dataset()).mask.pixels, left_mask(4).pixels);
  Image8 red(kWidth, kHeight, 3);
  for (int y = 0; y < kHeight; ++y)
    for (int x = 0; x < 4; ++x) red.at(x, y, 0) = 255;
  write_mask("masks/b.png", red);
  EXPECT_EQ(view(dataset()).mask.pixels, left_mask(4).pixels);
}

TEST_F(Masks, OfACutOutAreItsAlpha) {
  write_photos({"b.jpg"});
  write_mask("masks/b.png", with_alpha(plain_photo(kWidth, kHeight, 30), left_mask(5)));
  EXPECT_EQ(view(dataset()).mask.pixels, left_mask(5).pixels);
}

TEST_F(Masks, ThatAreWhiteEverywhereAreNone) {
  write_photos({"b.jpg"});
  write_mask("masks/b.png", left_mask(kWidth));
  EXPECT_TRUE(view(dataset()).mask.empty());
}

TEST_F(Masks, OfAnotherSizeAreResizedAndOfAnotherShapeRefused) {
  write_photos({"b.jpg"});
  write_mask("masks/b.png", left_mask(8, 24, 16));
  EXPECT_EQ(view(dataset()).mask.pixels, left_mask(4).pixels);
  write_mask("masks/b.png", left_mask(2, 6, 4));
  EXPECT_EQ(view(dataset()).mask.pixels, left_mask(4).pixels);
  write_mask("masks/b.png", left_mask(4, 8, 12));
  EXPECT_THAT(error(), AllOf(HasSubstr("masks/b.png has 8 x 12"),
                             HasSubstr("images/b.jpg has 12 x 8"), HasSubstr("another picture")));
}

TEST_F(Masks, ThatLeaveNothingDropTheirViewOrAreRefused) {
  write_photos({"b.jpg", "c.jpg"});
  write_mask("masks/b.png", left_mask(0));
  EXPECT_THAT(log_of(dataset()), HasSubstr("1 photo is masked everywhere and left out: b.jpg"));
  EXPECT_EQ(load_scene(dataset()).train_views.size(), 1u);
  write_mask("masks/c.png", left_mask(0));
  EXPECT_THAT(error(),
              AllOf(HasSubstr("no photo"), HasSubstr("--invert-masks"), HasSubstr("--masks none")));
  DatasetConfig background = dataset();
  background.mask_mode = MaskMode::background;  // only the background is left
  EXPECT_EQ(load_scene(background).train_views.size(), 2u);
}

TEST_F(Masks, SaySoWhereThereIsNone) {
  write_photos({"b.jpg"});
  EXPECT_THAT(log_of(dataset()), Not(HasSubstr("mask")));
  DatasetConfig background = dataset();
  background.mask_mode = MaskMode::background;
  EXPECT_THAT(log_of(background), HasSubstr("no photo has a mask or alpha"));
}

TEST_F(Masks, AreAlphaWhereThereIsNoFile) {
  write_photos({"b.png", "c.png"});
  for (const char* name : {"b.png", "c.png"})
    write_png(folder() / "images" / name,
              with_alpha(plain_photo(kWidth, kHeight, 30), left_mask(5)));
  write_mask("masks/c.png", left_mask(3));
  DatasetConfig alpha = dataset();
  alpha.invert_masks = true;  // changes mask files only, not alpha
  EXPECT_EQ(view(alpha, 0).mask.pixels, left_mask(5).pixels);
  EXPECT_EQ(view(dataset(), 1).mask.pixels, left_mask(3).pixels);
  EXPECT_EQ(view(dataset()).photo.pixels, plain_photo(kWidth, kHeight, 30).pixels);
  EXPECT_FALSE(view(dataset()).over_background);
  alpha.masks = "none";
  EXPECT_TRUE(view(alpha, 0).mask.empty());
  EXPECT_TRUE(view(alpha, 1).mask.empty());
}

TEST_F(Masks, ShowTheBackgroundInThatModeAlone) {
  write_photos({"b.jpg", "c.jpg"});
  write_mask("masks/b.png");
  DatasetConfig background = dataset();
  background.mask_mode = MaskMode::background;
  EXPECT_TRUE(view(background).over_background);
  EXPECT_FALSE(view(background).has_untrained_pixels());
  EXPECT_FALSE(view(background, 1).over_background);  // it has none
  EXPECT_TRUE(view(dataset()).has_untrained_pixels());
}

TEST_F(Masks, OfBlenderScenesShowTheBackground) {
  const std::string frames =
      "{\"camera_angle_x\": 0.8, \"frames\": [{\"file_path\": \"./train/a\", \"transform_matrix\": "
      "[[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]}]}";
  write_png(folder() / "train/a.png", with_alpha(plain_photo(kWidth, kHeight, 30), left_mask(5)));
  write_bytes(folder() / "transforms_train.json", frames);
  EXPECT_TRUE(view(dataset()).over_background);
  EXPECT_EQ(view(dataset()).mask.pixels, left_mask(5).pixels);
  DatasetConfig ignore = dataset();
  ignore.mask_mode = MaskMode::ignore;
  EXPECT_FALSE(view(ignore).over_background);
  std::filesystem::rename(folder() / "transforms_train.json", folder() / "transforms.json");
  EXPECT_FALSE(view(dataset()).over_background);
}

TEST_F(Masks, ThatTransformsJsonNamesAreTakenWhateverTheirPlace) {
  const std::string pose = "\"transform_matrix\": [[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]}";
  write_bytes(folder() / "transforms.json",
              "{\"camera_angle_x\": 0.8, \"frames\": [{\"file_path\": \"photos/a.png\", "
              "\"mask_path\": \"cut/of_a.png\", " +
                  pose + ", {\"file_path\": \"photos/b.png\", " + pose + "]}");
  for (const char* name : {"photos/a.png", "photos/b.png"})
    write_png(folder() / name, plain_photo(kWidth, kHeight, 30));
  EXPECT_THAT(error(), AllOf(HasSubstr("frame 0"), HasSubstr("of_a.png")));
  write_png(folder() / "cut/of_a.png", left_mask(5));
  EXPECT_EQ(view(dataset()).mask.pixels, left_mask(5).pixels);
  // SCENE/masks is only found by default: the mask_path of the file comes before it
  write_png(folder() / "masks/photos/a.png", left_mask(2));
  EXPECT_EQ(view(dataset()).mask.pixels, left_mask(5).pixels);
  DatasetConfig other = dataset();
  other.masks = "masks";
  EXPECT_EQ(view(other).mask.pixels, left_mask(2).pixels);
  other.masks = "none";
  EXPECT_TRUE(view(other).mask.empty());
}

/// A photo of 200 with `garbage` behind a mask of the left 50 columns, except for a gray column.
void write_masked_photo(const std::filesystem::path& folder, int width, int height,
                        std::uint8_t garbage) {
  Image8 mask = left_mask(50, width, height), photo = plain_photo(width, height, 200);
  for (int y = 0; y < height; ++y)
    for (int x = 50; x < width; ++x)
      for (int c = 0; c < 3; ++c) photo.at(x, y, c) = garbage;
  write_png(folder / "images/a.png", photo);
  write_png(folder / "masks/a.png", mask);
}

TEST_F(Masks, AreResizedWithThePhotoAndNothingOfWhatTheyCoverShows) {
  ColmapModel model = small_model(1);
  model.cameras[7] = {7, CameraModel::pinhole, 120, 80, {100, 100, 63, 38}};
  write(model);
  DatasetConfig small = dataset();
  small.resolution = 4;
  write_masked_photo(folder(), 120, 80, 0);
  const View clean = view(small);
  EXPECT_EQ(clean.mask.width, 30);
  EXPECT_EQ(clean.mask.at(11, 5, 0), 255);
  EXPECT_EQ(clean.mask.at(12, 5, 0), 128);  // half of its four columns
  EXPECT_EQ(clean.mask.at(13, 5, 0), 0);
  EXPECT_EQ(clean.photo.at(12, 5, 1), 199);  // 200 * 128 / 255 = 100.4, in whole numbers
  write_masked_photo(folder(), 120, 80, 255);
  EXPECT_EQ(view(small).photo.pixels, clean.photo.pixels);
  EXPECT_EQ(view(small).mask.pixels, clean.mask.pixels);
}

TEST_F(Masks, GoThroughTheLensWithThePhoto) {
  ColmapModel model = small_model(1);
  model.cameras[7] = {7, CameraModel::simple_radial, 120, 80, {100, 63, 38, -0.1}};
  write(model);
  write_masked_photo(folder(), 120, 80, 0);
  const View clean = view(dataset());
  write_masked_photo(folder(), 120, 80, 255);
  const View dirty = view(dataset());
  ASSERT_EQ(dirty.mask.width, dirty.camera.width);
  ASSERT_EQ(dirty.mask.height, dirty.camera.height);
  ASSERT_GT(dirty.camera.width, 120);
  int edge = 0;
  while (dirty.mask.at(edge, 0, 0) > 127) ++edge;
  // Finds where column 50 of the photo appears at the top, by the same resampling of a picture of
  // columns.
  Image8 columns(120, 80, 3);
  for (int y = 0; y < 80; ++y)
    for (int x = 0; x < 120; ++x)
      for (int c = 0; c < 3; ++c) columns.at(x, y, c) = std::uint8_t(2 * x);
  write_png(folder() / "images/a.png", columns);
  DatasetConfig unmasked = dataset();
  unmasked.masks = "none";
  const View shown = view(unmasked);
  EXPECT_NEAR(shown.photo.at(edge, 0, 0), 100, 4);
  for (int x = 0; x < dirty.mask.width; ++x)
    for (int y = 0; y < dirty.mask.height; ++y) {
      ASSERT_EQ(clean.mask.at(x, y, 0), dirty.mask.at(x, y, 0));
      if (dirty.mask.at(x, y, 0) > 0) {
        ASSERT_EQ(clean.photo.at(x, y, 0), 200) << x << " " << y;
        ASSERT_EQ(dirty.photo.at(x, y, 0), 200) << x << " " << y;
      }
    }
}

TEST_F(Masks, MultiplyAndDivideGiveBackWhatTrains) {
  Image8 photo(256, 3, 3), mask(256, 3, 1);
  for (int x = 0; x < 256; ++x)
    for (int y = 0; y < 3; ++y) {
      mask.at(x, y, 0) = std::uint8_t(y == 0 ? 255 : y == 1 ? 128 : 0);
      for (int c = 0; c < 3; ++c) photo.at(x, y, c) = std::uint8_t(x);
    }
  Image8 back = photo;
  multiply_by_mask(back, mask);
  divide_by_mask(back, mask);
  for (int x = 0; x < 256; ++x) {
    EXPECT_EQ(back.at(x, 0, 0), x);
    EXPECT_NEAR(back.at(x, 1, 1), x, 1);
    EXPECT_EQ(back.at(x, 2, 2), 0);
  }
}

Diagnosis diagnosis_of(const DatasetConfig& dataset, bool look_at_pictures) {
  Config config;
  config.dataset = dataset;
  return examine(config, look_at_pictures);
}
std::string said_of_masks(const Diagnosis& diagnosis, Finding::Level level) {
  std::string text;
  for (const Finding& finding : diagnosis.findings)
    if (finding.topic == "masks" && finding.level == level) {
      text += finding.text + "\n";
      for (const std::string& name : finding.names) text += name + "\n";
    }
  return text;
}

TEST_F(Masks, AreExaminedByTheDoctor) {
  using Level = Finding::Level;
  write_photos({"b.jpg", "c.jpg", "d.jpg"});
  EXPECT_EQ(said_of_masks(diagnosis_of(dataset(), true), Level::good), "");
  write_mask("masks/b.png", left_mask(6));
  EXPECT_THAT(said_of_masks(diagnosis_of(dataset(), false), Level::note),
              HasSubstr("2 photos have no mask"));  // b.jpg alone needed one
  write_mask("masks/c.png", left_mask(0));
  const Diagnosis headers = diagnosis_of(dataset(), false);
  EXPECT_THAT(said_of_masks(headers, Level::good), HasSubstr("2 of 3 photos have a mask"));
  EXPECT_THAT(said_of_masks(headers, Level::warning), HasSubstr("1 photo has no mask"));
  EXPECT_THAT(said_of_masks(headers, Level::warning), HasSubstr("d.jpg\n"));
  const Diagnosis pictures = diagnosis_of(dataset(), true);
  EXPECT_TRUE(pictures.can_train());
  EXPECT_THAT(said_of_masks(pictures, Level::good),
              HasSubstr("2 of 3 photos are masked; 25.0 % of their pixels train"));
  EXPECT_THAT(said_of_masks(pictures, Level::warning),
              AllOf(HasSubstr("1 mask leaves less than 5 %"), HasSubstr("c.jpg")));
  for (const char* name : {"masks/b.png", "masks/d.png"}) write_mask(name, left_mask(0));
  EXPECT_FALSE(diagnosis_of(dataset(), true).can_train());
  write_mask("masks/b.png", left_mask(2, 8, 12));
  EXPECT_FALSE(diagnosis_of(dataset(), false).can_train());
}

}  // namespace
}  // namespace gs
