// SPDX-License-Identifier: Apache-2.0
// FLIP against known values and against its definition, computed here term by term with
// two-dimensional filters, without any code or constant of ours.
#include "gs_eval/flip/flip.h"
#include "gs_eval/metrics.h"
#include "tests/support/small_scene.h"

namespace gs {
namespace {

using Triple = std::array<double, 3>;

ImageF flat(int width, int height, const Triple& color) {
  ImageF image(width, height, 3);
  for (std::size_t i = 0; i < image.pixels.size(); ++i) image.pixels[i] = float(color[i % 3]);
  return image;
}

/// Waves of several lengths, with an edge and single bright pixels, and `noise` on top.
ImageF pattern(int width, int height, float noise, std::uint64_t seed) {
  const Image8 random = random_photo(width, height, seed);
  ImageF image(width, height, 3);
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x)
      for (int c = 0; c < 3; ++c) {
        double value = 0.45 + 0.2 * std::sin(0.5 * x + c) + 0.15 * std::cos(0.11 * y - 0.2 * c * x);
        if (x > width / 2) value += 0.15;
        if (x % 13 == 3 && y % 11 == 5) value += 0.3;
        value += noise * (random.at(x, y, c) / 255.0 - 0.5);
        image.at(x, y, c) = float(std::clamp(value, 0.0, 1.0));
      }
  return image;
}

// ---- FLIP

double curve(double t) { return t > 216.0 / 24389 ? std::cbrt(t) : (24389.0 / 27 * t + 16) / 116; }
double linear(double c) { return c <= 0.04045 ? c / 12.92 : std::pow((c + 0.055) / 1.055, 2.4); }

/// XYZ of linear sRGB over that of white.
Triple relative_xyz(const Triple& rgb) {
  const double X = (10135552 * rgb[0] + 8788810 * rgb[1] + 4435075 * rgb[2]) / 24577794;
  const double Y = (2613072 * rgb[0] + 8788810 * rgb[1] + 887015 * rgb[2]) / 12288897;
  const double Z = (1425312 * rgb[0] + 8788810 * rgb[1] + 70074185 * rgb[2]) / 73733382;
  return {X / 0.950428545, Y, Z / 1.088900371};
}
/// The usual inverse of that matrix, to the digits that are printed with it.
Triple rgb_of(const Triple& relative) {
  const double X = relative[0] * 0.950428545, Y = relative[1], Z = relative[2] * 1.088900371;
  return {3.241003275 * X - 1.537398934 * Y - 0.498615861 * Z,
          -0.969224334 * X + 1.875930071 * Y + 0.041554224 * Z,
          0.055639423 * X - 0.204011202 * Y + 1.057148933 * Z};
}
Triple opponent(const ImageF& image, int x, int y) {
  x = std::clamp(x, 0, image.width - 1);
  y = std::clamp(y, 0, image.height - 1);
  const Triple n = relative_xyz(
      {linear(image.at(x, y, 0)), linear(image.at(x, y, 1)), linear(image.at(x, y, 2))});
  return {116 * n[1] - 16, 500 * (n[0] - n[1]), 200 * (n[1] - n[2])};
}
Triple hunt(const Triple& rgb) {
  const Triple n = relative_xyz(rgb);
  const double L = 116 * curve(n[1]) - 16;
  return {L, 0.01 * L * 500 * (curve(n[0]) - curve(n[1])),
          0.01 * L * 200 * (curve(n[1]) - curve(n[2]))};
}
double distance(const Triple& a, const Triple& b) {
  return std::abs(a[0] - b[0]) + std::hypot(a[1] - b[1], a[2] - b[2]);
}

constexpr double kPi = 3.14159265358979323846, kPerDegree = 3840 * kPi / 180;

/// What the observer sees of a pixel: its color, edge and point.
struct Seen {
  Triple lab;
  double edge, point;
};

Seen plain_seen(const ImageF& image, int x, int y) {
  Triple sums = {0, 0, 0}, totals = {0, 0, 0};
  for (int j = -10; j <= 10; ++j)
    for (int i = -10; i <= 10; ++i) {
      const double r2 = (i * i + j * j) / (kPerDegree * kPerDegree);
      const auto term = [&](double a, double b) {
        return a * std::sqrt(kPi / b) * std::exp(-kPi * kPi * r2 / b);
      };
      const Triple weights = {term(1, 0.0047), term(1, 0.0053),
                              term(34.1, 0.04) + term(13.5, 0.025)};
      const Triple value = opponent(image, x + i, y + j);
      for (int c = 0; c < 3; ++c) sums[c] += weights[c] * value[c], totals[c] += weights[c];
    }
  for (int c = 0; c < 3; ++c) sums[c] /= totals[c];
  const double Y = (sums[0] + 16) / 116;
  Triple rgb = rgb_of({Y + sums[1] / 500, Y, Y - sums[2] / 200});
  for (double& value : rgb) value = std::clamp(value, 0.0, 1.0);

  const double sigma = 0.5 * 0.082 * kPerDegree;
  double features[4];
  for (int kind = 0; kind < 4; ++kind) {  // edges in x and y, points in x and y
    double weights[19][19], positive = 0, negative = 0, sum = 0;
    for (int j = -9; j <= 9; ++j)
      for (int i = -9; i <= 9; ++i) {
        const double along = kind % 2 ? j : i;
        const double w = (kind < 2 ? -along : along * along / (sigma * sigma) - 1) *
                         std::exp(-(i * i + j * j) / (2 * sigma * sigma));
        weights[j + 9][i + 9] = w;
        (w > 0 ? positive : negative) += w;
      }
    for (int j = -9; j <= 9; ++j)
      for (int i = -9; i <= 9; ++i) {
        const double w = weights[j + 9][i + 9];
        sum += w / (w > 0 ? positive : -negative) * (opponent(image, x + i, y + j)[0] + 16) / 116;
      }
    features[kind] = sum;
  }
  return {hunt(rgb), std::hypot(features[0], features[1]), std::hypot(features[2], features[3])};
}

double plain_flip(const ImageF& a, const ImageF& b, int x, int y) {
  const Seen p = plain_seen(a, x, y), q = plain_seen(b, x, y);
  const double largest = std::pow(distance(hunt({0, 1, 0}), hunt({0, 0, 1})), 0.7);
  const double c = std::pow(distance(p.lab, q.lab), 0.7), knee = 0.4 * largest;
  const double color = c < knee ? 0.95 * c / knee : 0.95 + 0.05 * (c - knee) / (largest - knee);
  const double feature = std::max(std::abs(p.edge - q.edge), std::abs(p.point - q.point));
  return std::pow(color, 1 - std::sqrt(feature / std::sqrt(2.0)));
}

// The first four agree with NVIDIA's program to the digits that it prints.
TEST(Flip, OfFlatPicturesAreTheKnownValues) {
  const auto of = [](const Triple& a, const Triple& b) {
    return flip({flat(25, 22, a), flat(25, 22, b), {}});
  };
  EXPECT_NEAR(of({0.5, 0.5, 0.5}, {0.6, 0.6, 0.6}), 0.285013, 1e-6);
  EXPECT_NEAR(of({128 / 255.0, 128 / 255.0, 128 / 255.0}, {129 / 255.0, 129 / 255.0, 129 / 255.0}),
              0.029855, 1e-6);
  EXPECT_NEAR(of({0, 0, 0}, {1, 1, 1}), 0.967380, 1e-6);
  EXPECT_NEAR(of({0, 1, 0}, {0, 0, 1}), 1, 1e-6);
  EXPECT_NEAR(of({0.5, 0.5, 0.5}, {0.5, 0.5, 0.6}), 0.263163, 1e-6);
}

// Every pixel, also at the border. The printed inverse matrix has 9 digits.
TEST(Flip, IsThatOfThePlainDefinitionAtEachPixel) {
  const ImageF photo = pattern(33, 21, 0.1f, 8), render = pattern(33, 21, 0.5f, 9);
  const ImageF map = flip_map(render, photo);
  double sum = 0;
  for (int y = 0; y < photo.height; ++y)
    for (int x = 0; x < photo.width; ++x) {
      const double expected = plain_flip(render, photo, x, y);
      EXPECT_NEAR(map.at(x, y, 0), expected, 2e-6) << x << " " << y;
      sum += expected;
    }
  const double mean = flip({render, photo, {}});
  EXPECT_NEAR(mean, sum / (33 * 21), 1e-6);
  EXPECT_GT(mean, 0.05);
}

TEST(Flip, OfIdenticalPicturesIsZero) {
  const ImageF photo = pattern(40, 30, 0.3f, 10);
  EXPECT_EQ(flip({photo, photo, {}}), 0);
}

// A picture of two colors, of which the mask keeps one.
TEST(Flip, CountsAPixelAsMuchAsItsWeight) {
  const ImageF photo = flat(90, 4, {0.5, 0.5, 0.5});
  ImageF render = photo, weight(90, 4, 1);
  for (int y = 0; y < 4; ++y)
    for (int x = 45; x < 90; ++x)
      for (int c = 0; c < 3; ++c) render.at(x, y, c) = 0.6f;
  for (int y = 0; y < 4; ++y) weight.at(0, y, 0) = 1, weight.at(89, y, 0) = 0.25f;
  const ImageF map = flip_map(render, photo);
  EXPECT_NEAR(map.at(89, 0, 0), 0.285013, 1e-5);
  EXPECT_NEAR(flip({render, photo, weight}), 0.25 / 1.25 * 0.285013, 1e-5);
}

// ---- as the evaluation calls it

TEST(PerceptualMetrics, DoNotDependOnTheNumberOfThreads) {
  const ImageF photo = pattern(70, 150, 0.1f, 11), render = pattern(70, 150, 0.5f, 12);
  const ComparedPictures pictures{render, photo, {}};
  const auto measured = [&] { return flip(pictures); };
  EXPECT_EQ(with_threads(1, measured), with_threads(5, measured));
}

TEST(PerceptualMetrics, OfAMaskedViewDoNotSeeTheRest) {
  View view;
  view.photo = random_photo(60, 40, 3);
  view.mask = Image8(60, 40, 1, 0);
  for (int x = 12; x < 45; ++x)
    for (int y = 8; y < 30; ++y) view.mask.at(x, y, 0) = 255;
  ImageF render(60, 40, 3);
  for (std::size_t i = 0; i < render.pixels.size(); ++i)
    render.pixels[i] = view.photo.pixels[i] / 255.0f;
  for (int i = 0; i < 25; ++i)
    render.at(20 + i % 5, 15 + i / 5, 1) = 1 - render.at(20 + i % 5, 15 + i / 5, 1);
  const PerceptualMetrics before = perceptual_metrics(render, view, {});
  EXPECT_GT(before.flip, 0);
  for (int x = 0; x < 60; ++x)
    for (int c = 0; c < 3; ++c) render.at(x, 5, c) = 0.3f;
  EXPECT_EQ(perceptual_metrics(render, view, {}).flip, before.flip);
}

TEST(PerceptualMetrics, GiveThePhotosExposureToTheRender) {
  View view;
  view.photo = Image8(24, 16, 3, 100);
  view.exposure = {0.5f, 1, 2};
  ImageF render(24, 16, 3, 100 / 255.0f);
  for (std::size_t i = 0; i < render.pixels.size(); ++i)
    render.pixels[i] /= view.exposure[int(i % 3)];
  EXPECT_LT(perceptual_metrics(render, view, {}).flip, 1e-3);
  EXPECT_GT(perceptual_metrics(render, view.photo).flip, 0.1);
}

TEST(PerceptualMetrics, AreMeasuredWhereTheyAreAskedFor) {
  const Gaussians gaussians = random_gaussians(kTypical, 50, random_camera(40, 30, 1), 3);
  std::vector<View> views = random_views(2, 40, 30);
  views[0].exposure = Vec3f(0.5f);
  const auto renderer = make_scalar_renderer();
  const auto measured = [&](MetricSet metrics, std::vector<ImageF>* pictures) {
    return evaluate(
        *renderer, gaussians.span(), views, {},
        [&](std::size_t, const View&, const ImageF& picture) {
          if (pictures) pictures->push_back(picture);
        },
        metrics);
  };
  const Evaluation quick = measured(MetricSet::quick, nullptr);
  EXPECT_FALSE(quick.perceptual || quick.views[0].perceptual);
  std::vector<ImageF> pictures;
  const Evaluation all = measured(MetricSet::all, &pictures);
  EXPECT_EQ(all.psnr, quick.psnr);
  EXPECT_EQ(all.ssim, quick.ssim);
  ASSERT_TRUE(all.perceptual && all.perceptual_exposure);
  for (std::size_t i = 0; i < 2; ++i) {
    const PerceptualMetrics expected = perceptual_metrics(pictures[i], views[i].photo);
    EXPECT_EQ(all.views[i].perceptual->flip, expected.flip);
  }
  const auto& [first, second] = std::tie(*all.views[0].perceptual, *all.views[1].perceptual);
  EXPECT_NEAR(all.perceptual->flip, (first.flip + second.flip) / 2, 1e-12);
  EXPECT_EQ(all.views[1].perceptual_exposure->flip, second.flip);
  EXPECT_NEAR(all.views[0].perceptual_exposure->flip,
              perceptual_metrics(pictures[0], views[0], {}).flip, 1e-6);
  EXPECT_NE(all.views[0].perceptual_exposure->flip, first.flip);
}

}  // namespace
}  // namespace gs
