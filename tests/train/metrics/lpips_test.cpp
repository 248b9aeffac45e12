// SPDX-License-Identifier: Apache-2.0
// LPIPS with small networks: figures known in closed form, figures of lpips_reference.py, and files
// that do not hold such a network.
#include "gs_eval/lpips/lpips.h"

#include "gs_eval/metrics.h"
#include "tests/support/lpips_file.h"
#include "tests/support/small_scene.h"

namespace gs {
namespace {

constexpr double kRounding = 1e-6;  // relative: OpenCV's convolutions are in float

class LpipsTest : public testing::Test {
 protected:
  void SetUp() override {
    if (!can_measure_lpips()) GTEST_SKIP() << "built without OpenCV's module dnn";
  }
  std::string write(const Arrays& arrays) {
    return write_network(folder_.path() / "net.safetensors", arrays);
  }
  double distance(const Arrays& arrays, const ComparedPictures& pictures) {
    return Lpips(write(arrays)).distance(pictures);
  }
  std::string refusal(const Arrays& arrays) {
    const std::string file = write(arrays);
    const std::string error = error_of([&] { Lpips network(file); });
    EXPECT_THAT(error, AllOf(HasSubstr(file), HasSubstr("docs/method/equations.md")));
    return error;
  }

  TempFolder folder_;
};

ImageF flat(int width, int height, const Vec3f& color) {
  ImageF image(width, height, 3);
  for (std::size_t i = 0; i < image.pixels.size(); ++i) image.pixels[i] = color[int(i % 3)];
  return image;
}

ImageF pattern(int width, int height, int seed) {
  ImageF image(width, height, 3);
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x)
      for (int c = 0; c < 3; ++c)
        image.at(x, y, c) =
            float((37 * x + 91 * y + 53 * c + 17 * seed + (3 + seed) * x * y) % 256 / 255.0);
  return image;
}

// The color 0.875 is 0.75 in [-1, 1], so the features (0.75, 1) have the direction (0.6, 0.8). The
// color 0.5 gives (0, 1). With the importance (2, 5) they are 2 * 0.6^2 + 5 * 0.2^2 apart.
constexpr double kOneStage = 0.92;

TEST_F(LpipsTest, IsTheKnownDistanceOfFlatPictures) {
  const ComparedPictures pictures{
      flat(40, 33, {0.875f, 0.1f, 0.3f}), flat(40, 33, {0.5f, 0.9f, 1}), {}};
  EXPECT_NEAR(distance(color_network(0, {2, 5}), pictures), 5 * kOneStage, kRounding);
}

TEST_F(LpipsTest, TakesRedGreenAndBlueInThisOrder) {
  for (int color = 0; color < 3; ++color)
    for (int changed = 0; changed < 3; ++changed) {
      Vec3f render(0.5f);
      render[changed] = 0.875f;
      EXPECT_NEAR(distance(color_network(color, {2, 5}),
                           {flat(40, 33, render), flat(40, 33, Vec3f(0.5f)), {}}),
                  color == changed ? 5 * kOneStage : 0, kRounding)
          << color << changed;
    }
}

TEST_F(LpipsTest, ShiftsAndScalesTheColors) {
  Arrays arrays = color_network(1, {2, 5});
  arrays.at("scaling_layer.shift").values = {9, 0.25f, 9};
  arrays.at("scaling_layer.scale").values = {3, 0.5f, 3};
  // (2 * 0.8125 - 1 - 0.25) / 0.5 = 0.75, (2 * 0.625 - 1 - 0.25) / 0.5 = 0
  EXPECT_NEAR(distance(arrays, {flat(40, 33, Vec3f(0.8125f)), flat(40, 33, Vec3f(0.625f)), {}}),
              5 * kOneStage, kRounding);
}

TEST_F(LpipsTest, IsThatOfTheDefinitionInNumPy) {
  struct Figure {
    const char* network;
    int width, height;
    double distance;
  };
  const Figure figures[] = {// printed by lpips_reference.py
                            {"alex", 47, 33, 0.639928990316},
                            {"alex", 52, 70, 1.719684190244},
                            {"vgg", 47, 33, 1.513112196300},
                            {"vgg", 52, 70, 1.613923554520}};
  for (const Figure& figure : figures) {
    const bool is_alex = figure.network == std::string("alex");
    const std::vector<int> channels =
        is_alex ? std::vector{4, 6, 5, 3, 4} : std::vector{4, 3, 5, 6, 4};
    Lpips network(write(patterned_network(figure.network, channels)));
    EXPECT_EQ(network.source().network, figure.network);
    const ComparedPictures pictures{
        pattern(figure.width, figure.height, 1), pattern(figure.width, figure.height, 2), {}};
    EXPECT_NEAR(network.distance(pictures), figure.distance, kRounding * figure.distance)
        << figure.network << figure.width;
  }
}

TEST_F(LpipsTest, OneNetworkTakesPicturesOfSeveralSizes) {
  const Arrays arrays = patterned_network("alex", {4, 6, 5, 3, 4});
  Lpips network(write(arrays));
  for (const int size : {40, 64, 40}) {
    const ComparedPictures pictures{pattern(size, 50, 1), pattern(size, 50, 2), {}};
    EXPECT_EQ(network.distance(pictures), distance(arrays, pictures)) << size;
  }
}

TEST_F(LpipsTest, OfIdenticalPicturesIsZero) {
  const ImageF picture = pattern(45, 38, 3);
  EXPECT_EQ(distance(patterned_network("vgg", {2, 2, 2, 2, 2}), {picture, picture, {}}), 0);
}

TEST_F(LpipsTest, DoesNotDependOnTheNumberOfThreads) {
  const ComparedPictures pictures{pattern(90, 77, 1), pattern(90, 77, 2), {}};
  Lpips network(write(patterned_network("vgg", {4, 3, 5, 6, 4})));
  const auto measured = [&] { return network.distance(pictures); };
  const double first = with_threads(1, measured);
  EXPECT_NEAR(with_threads(5, measured), first, kRounding * first);
}

// Features see the middle of their places, so none of those that count sees the black half. Where
// both pictures are black, their features are equal: without weights the mean would be lower.
TEST_F(LpipsTest, CountsAPlaceAsMuchAsItsPixels) {
  Arrays arrays = color_network(0, {2, 5});
  for (int stage = 1; stage < 5; ++stage)
    arrays.at("lin" + std::to_string(stage) + ".model.1.weight").values = {0, 0};
  ComparedPictures pictures{flat(64, 40, {0.875f, 0, 0}), flat(64, 40, {0.5f, 0, 0}),
                            ImageF(64, 40, 1)};
  for (int y = 0; y < 40; ++y)
    for (int x = 0; x < 64; ++x) {
      pictures.weight.at(x, y, 0) = x < 32 ? 1.0f : 0.0f;
      for (int c = 0; c < 3 && x >= 32; ++c)
        pictures.render.at(x, y, c) = pictures.photo.at(x, y, c) = 0;
    }
  EXPECT_NEAR(distance(arrays, pictures), kOneStage, kRounding);
  pictures.weight = {};
  EXPECT_NEAR(distance(arrays, pictures), kOneStage * 8 / 15, kRounding);  // 8 of 15 columns
}

TEST_F(LpipsTest, PicturesWithoutFeaturesAreRefused) {
  Lpips alex(write(color_network(0, {1, 1})));
  EXPECT_EQ(alex.distance({pattern(31, 31, 1), pattern(31, 31, 1), {}}), 0);
  for (const bool is_high : {false, true}) {
    const ImageF picture = is_high ? pattern(30, 60, 1) : pattern(60, 30, 1);
    EXPECT_THAT(error_of([&] {
                  alex.distance({picture, picture, {}});
                }),
                AllOf(HasSubstr("needs 31x31"), HasSubstr("--lpips none")));
  }
  Lpips vgg(write(empty_network("vgg", {1, 1, 1, 1, 1})));
  EXPECT_EQ(vgg.distance({pattern(16, 16, 1), pattern(16, 16, 2), {}}), 0);
  EXPECT_THAT(error_of([&] {
                vgg.check_sizes({{"a", random_camera(20, 15, 1), {}}});
              }),
              HasSubstr("20x15"));
}

// ---- files

TEST_F(LpipsTest, TheFileTellsItsNetworkAndHash) {
  const std::string file = write(color_network(0, {1, 1}));
  const LpipsSource source = Lpips(file).source();
  EXPECT_EQ(source.file, file);
  EXPECT_EQ(source.network, "alex");
  EXPECT_EQ(source.hash.size(), 16u);
  EXPECT_NE(Lpips(write(color_network(1, {1, 1}))).source().hash, source.hash);
}

TEST_F(LpipsTest, LayersWithoutDropoutHaveAnotherNumber) {
  Arrays arrays = color_network(0, {2, 5});
  const ComparedPictures pictures{pattern(40, 40, 1), pattern(40, 40, 2), {}};
  const double expected = distance(arrays, pictures);
  for (int stage = 0; stage < 5; ++stage) {
    auto node = arrays.extract("lin" + std::to_string(stage) + ".model.1.weight");
    node.key() = "lin" + std::to_string(stage) + ".model.0.weight";
    arrays.insert(std::move(node));
  }
  EXPECT_GT(expected, 0);
  EXPECT_EQ(distance(arrays, pictures), expected);
}

TEST_F(LpipsTest, NetworksOfAnotherFormAreRefused) {
  Arrays arrays = color_network(0, {1, 1});
  arrays.at("net.slice1.0.weight") = zeros({2, 4, 11, 11});  // of pictures with four channels
  EXPECT_THAT(refusal(arrays), HasSubstr("net.slice1.0.weight has the shape (2, 4, 11, 11) and not "
                                         "(0, 3, 11, 11)"));
  arrays = color_network(0, {1, 1});
  arrays.at("net.slice3.6.bias") = zeros({3});
  EXPECT_THAT(refusal(arrays), HasSubstr("net.slice3.6.bias has the shape (3) and not (2)"));
  arrays = color_network(0, {1, 1});
  arrays.erase("lin2.model.1.weight");
  EXPECT_THAT(refusal(arrays), HasSubstr("it has no lin2.model.1.weight"));
  arrays = color_network(0, {1, 1});
  arrays.at("scaling_layer.scale").values[1] = 0;
  EXPECT_THAT(refusal(arrays), HasSubstr("scaling_layer.scale"));
  EXPECT_THAT(refusal({{"net.slice2.3.squeeze.weight", zeros({1})}}),
              HasSubstr("does not hold LPIPS with AlexNet or VGG-16"));
}

TEST_F(LpipsTest, AFileThatIsCutShortIsRefused) {
  const std::string file = write(color_network(0, {1, 1})), bytes = read_bytes(file);
  for (std::size_t size = 0; size < bytes.size(); size += 1 + size / 20) {
    write_bytes(file, bytes.substr(0, size));
    EXPECT_THAT(error_of([&] { Lpips network(file); }), HasSubstr(file)) << size;
  }
}

TEST_F(LpipsTest, SettingsNameTheNetworkOrNone) {
  const std::string file = write(color_network(0, {1, 1}));
  EXPECT_EQ(make_lpips({file})->source().file, file);
  EXPECT_EQ(make_lpips({""}), nullptr);
  EXPECT_EQ(make_lpips({"none"}), nullptr);
  EXPECT_THAT(error_of([&] { make_lpips({file + "x"}); }),
              AllOf(HasSubstr(file + "x"), HasSubstr("--lpips none")));
}

// ---- in evaluations

TEST_F(LpipsTest, IsMeasuredWhereItIsAskedFor) {
  const Gaussians gaussians = random_gaussians(kTypical, 50, random_camera(40, 36, 1), 3);
  std::vector<View> views = random_views(2, 40, 36);
  views[0].exposure = Vec3f(0.5f);
  Lpips network(write(patterned_network("alex", {4, 6, 5, 3, 4})));
  const auto renderer = make_scalar_renderer();
  const Evaluation without = evaluate(*renderer, gaussians.span(), views, {}, {}, MetricSet::all);
  EXPECT_FALSE(without.perceptual->lpips || without.lpips_source);
  std::vector<ImageF> renders;
  const Evaluation with = evaluate(
      *renderer, gaussians.span(), views, {},
      [&](std::size_t, const View&, const ImageF& render) { renders.push_back(render); },
      MetricSet{true, &network});
  EXPECT_EQ(with.perceptual->flip, without.perceptual->flip);
  EXPECT_EQ(with.lpips_source->hash, network.source().hash);
  double sum = 0;
  for (std::size_t i = 0; i < 2; ++i) {
    ImageF photo(40, 36, 3);
    for (std::size_t k = 0; k < photo.pixels.size(); ++k)
      photo.pixels[k] = float(views[i].photo.pixels[k] / 255.0);
    EXPECT_EQ(*with.views[i].perceptual->lpips, network.distance({renders[i], photo, {}}));
    sum += *with.views[i].perceptual->lpips;
  }
  EXPECT_NEAR(*with.perceptual->lpips, sum / 2, 1e-12);
  EXPECT_NE(with.views[0].perceptual_exposure->lpips, with.views[0].perceptual->lpips);
  EXPECT_EQ(with.views[1].perceptual_exposure->lpips, with.views[1].perceptual->lpips);
}

TEST(Lpips, WithoutOpenCvTheErrorSaysWhatToDo) {
  if (can_measure_lpips()) GTEST_SKIP() << "built with OpenCV's module dnn";
  const TempFolder folder;
  const std::string file = write_network(folder.path() / "n", color_network(0, {1, 1}));
  EXPECT_THAT(error_of([&] { make_lpips({file}); }), HasSubstr("gemsplat eval RUN --lpips FILE"));
}

}  // namespace
}  // namespace gs
