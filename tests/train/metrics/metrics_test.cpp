// SPDX-License-Identifier: Apache-2.0
#include "gs_eval/metrics.h"

#include "gs_eval/panorama_metrics.h"
#include "tests/support/small_scene.h"

namespace gs {
namespace {

/// The photo's own values, as a rendered picture.
ImageF picture_of(const Image8& photo) {
  ImageF picture(photo.width, photo.height, 3);
  for (std::size_t i = 0; i < picture.pixels.size(); ++i)
    picture.pixels[i] = photo.pixels[i] / 255.0f;
  return picture;
}

// mse = (51 / 255)^2 = 0.04: -10 log10(0.04) = 13.979400.
TEST(Psnr, OfAConstantDifferenceIsTheHandValue) {
  EXPECT_NEAR(psnr(ImageF(5, 4, 3, 0.0f), Image8(5, 4, 3, 51)), 13.979400086720375, 1e-9);
}

TEST(Psnr, OfIdenticalPicturesIs100) {
  EXPECT_EQ(psnr(ImageF(5, 4, 3, 1.0f), Image8(5, 4, 3, 255)), 100.0);
  const Image8 photo = random_photo(20, 10, 1);
  EXPECT_EQ(psnr(picture_of(photo), photo), 100.0);
}

// Rows at latitudes of 67.5 and 22.5 degrees; the error is in one of the outer ones. mse = 0.04
// 0.38268343 / (2 (0.38268343 + 0.92387953)) = 0.0058578644. Half of the photo is masked.
TEST(WsPsnr, CountsErrorsByTheCosineOfTheirLatitude) {
  View panorama{"a.jpg", {}, Image8(8, 4, 3, 0)};
  for (int x = 0; x < 8; ++x)
    for (int c = 0; c < 3; ++c) panorama.photo.at(x, 0, c) = 51;
  const ImageF black(8, 4, 3, 0.0f);
  EXPECT_NEAR(ws_psnr(black, panorama, {}), 22.322606875, 1e-8);
  panorama.mask = Image8(8, 4, 1, 255);
  for (int y = 0; y < 4; ++y)
    for (int x = 4; x < 8; ++x) panorama.mask.at(x, y, 0) = 0;
  panorama.photo.at(5, 2, 0) = 255;  // not seen
  EXPECT_NEAR(ws_psnr(black, panorama, {}), 22.322606875, 1e-8);
}

/// SSIM as the reference trainer computes it, term by term: an 11x11 window of 2-D Gaussian weights
/// of sigma 1.5 that add up to 1, zeros outside of the picture (conv2d with padding 5), C1 =
/// 0.01^2, C2 = 0.03^2, the mean over all values. It is computed in double, as a sum of 121 terms
/// for each value, without any code or constant of ours.
double plain_ssim(const ImageF& a, const Image8& b) {
  double weights[11][11], total = 0;
  for (int i = 0; i < 11; ++i)
    for (int j = 0; j < 11; ++j)
      total += weights[i][j] = std::exp(-((i - 5) * (i - 5) + (j - 5) * (j - 5)) / (2 * 1.5 * 1.5));
  double sum = 0;
  for (int c = 0; c < 3; ++c)
    for (int y = 0; y < a.height; ++y)
      for (int x = 0; x < a.width; ++x) {
        double m1 = 0, m2 = 0, m11 = 0, m22 = 0, m12 = 0;
        for (int i = 0; i < 11; ++i)
          for (int j = 0; j < 11; ++j) {
            const int u = x + j - 5, v = y + i - 5;
            if (u < 0 || v < 0 || u >= a.width || v >= a.height) continue;
            const double w = weights[i][j] / total, p = a.at(u, v, c), q = b.at(u, v, c) / 255.0;
            m1 += w * p, m2 += w * q, m11 += w * p * p, m22 += w * q * q, m12 += w * p * q;
          }
        const double C1 = 0.01 * 0.01, C2 = 0.03 * 0.03;
        sum += (2 * m1 * m2 + C1) * (2 * (m12 - m1 * m2) + C2) /
               ((m1 * m1 + m2 * m2 + C1) * ((m11 - m1 * m1) + (m22 - m2 * m2) + C2));
      }
  return sum / (3.0 * a.width * a.height);
}

// A smooth picture with noise of several strengths, wider and higher than the window, and one that
// is smaller than it.
TEST(Ssim, IsThatOfThePlainDefinitionInDouble) {
  for (const auto& [width, height] : {std::pair(37, 29), {7, 4}})
    for (const float noise : {0.02f, 0.1f, 0.5f}) {
      Image8 photo(width, height, 3);
      const Image8 random = random_photo(width, height, 9);
      for (int y = 0; y < height; ++y)
        for (int x = 0; x < width; ++x)
          for (int c = 0; c < 3; ++c)
            photo.at(x, y, c) = std::uint8_t(120 + 90 * std::sin(0.2 * x + 0.31 * y + c));
      ImageF picture = picture_of(photo);
      for (std::size_t i = 0; i < picture.pixels.size(); ++i)
        picture.pixels[i] =
            std::clamp(picture.pixels[i] + noise * (random.pixels[i] / 255.0f - 0.5f), 0.0f, 1.0f);
      // float moments
      EXPECT_NEAR(ssim(picture, photo), plain_ssim(picture, photo), 2e-5) << noise;
    }
}

// Half of the pixels are trained and differ by 51: 13.979400 dB, as above, whatever the other half
// shows.
TEST(Psnr, OfAMaskedViewIsThatOfItsTrainedPixels) {
  View view;
  view.photo = Image8(4, 2, 3, 51);
  view.mask = Image8(4, 2, 1, 0);
  ImageF render(4, 2, 3, 0.0f);
  for (int x = 0; x < 2; ++x)
    for (int y = 0; y < 2; ++y) view.mask.at(x, y, 0) = 255;
  for (int c = 0; c < 3; ++c) render.at(3, 1, c) = 1;
  EXPECT_NEAR(psnr(render, view, {}), 13.979400086720375, 1e-9);
  // A pixel of mask 51 counts a fifth: (4 * 0.04 + 0.2 * 0.64) / 4.2.
  view.mask.at(3, 1, 0) = 51;
  EXPECT_NEAR(psnr(render, view, {}), -10 * std::log10((4 * 0.04 + 0.2 * 0.64) / 4.2), 1e-6);
}

TEST(Ssim, OfAMaskedViewDoesNotSeeTheRest) {
  View view;
  view.photo = random_photo(20, 10, 3);
  view.mask = Image8(20, 10, 1, 0);
  for (int x = 4; x < 15; ++x)
    for (int y = 2; y < 7; ++y) view.mask.at(x, y, 0) = 255;
  ImageF render = picture_of(view.photo);
  EXPECT_NEAR(ssim(render, view, {}), 1, 1e-6);
  for (int x = 0; x < 20; ++x)
    for (int c = 0; c < 3; ++c) render.at(x, 9, c) = 0.3f;
  EXPECT_NEAR(ssim(render, view, {}), 1, 1e-6);
  EXPECT_EQ(psnr(render, view, {}), 100);
  render.at(8, 4, 0) = 1 - render.at(8, 4, 0);
  EXPECT_LT(ssim(render, view, {}), 0.9999);
}

TEST(Metrics, OfAViewOverTheBackgroundSeeThePhotoThere) {
  View view;
  view.photo = random_photo(20, 10, 4);
  view.mask = Image8(20, 10, 1, 0);
  for (int x = 0; x < 12; ++x) view.mask.at(x, 5, 0) = 255;
  view.over_background = true;
  const Vec3f background{0.2f, 0.4f, 0.8f};  // 51, 102, 204
  const Image8 shown = shown_photo(view, background);
  EXPECT_EQ(shown.at(11, 5, 1), view.photo.at(11, 5, 1));
  EXPECT_EQ(shown.at(12, 5, 0), 51);
  EXPECT_EQ(shown.at(0, 0, 2), 204);
  ImageF render = picture_of(shown);
  EXPECT_GT(psnr(render, view, background), 99);
  EXPECT_NEAR(ssim(render, view, background), 1, 1e-6);
  render.at(0, 0, 0) += 0.3f;  // every pixel counts
  EXPECT_NEAR(psnr(render, view, background), -10 * std::log10(0.09 / 600), 1e-4);
}

TEST(Metrics, GiveThePhotosExposureToTheRender) {
  View view;
  view.photo = Image8(16, 12, 3, 100);
  view.exposure = {0.5f, 1, 2};
  ImageF render(16, 12, 3, 100 / 255.0f);
  for (std::size_t i = 0; i < render.pixels.size(); ++i)
    render.pixels[i] /= view.exposure[int(i % 3)];
  EXPECT_GT(psnr(render, view, {}), 99);
  EXPECT_NEAR(ssim(render, view, {}), 1, 1e-6);
}

TEST(Evaluate, AveragesOverViewsAndShowsEachPictureInOrder) {
  const Gaussians gaussians = random_gaussians(kTypical, 50, random_camera(40, 30, 1), 3);
  const std::vector<View> views = random_views(2, 40, 30);
  const auto renderer = make_scalar_renderer();
  std::vector<ImageF> pictures;
  const Evaluation evaluation =
      evaluate(*renderer, gaussians.span(), views, {},
               [&](std::size_t i, const View& view, const ImageF& picture) {
                 EXPECT_EQ(i, pictures.size());
                 EXPECT_EQ(view.name, views[i].name);
                 pictures.push_back(picture);
               });
  ASSERT_EQ(evaluation.views.size(), 2u);
  for (std::size_t i = 0; i < 2; ++i) {
    EXPECT_EQ(evaluation.views[i].name, views[i].name);
    EXPECT_EQ(evaluation.views[i].psnr, psnr(pictures[i], views[i].photo));
    EXPECT_EQ(evaluation.views[i].ssim, ssim(pictures[i], views[i].photo));
  }
  EXPECT_NEAR(evaluation.psnr, (evaluation.views[0].psnr + evaluation.views[1].psnr) / 2, 1e-12);
  EXPECT_NEAR(evaluation.ssim, (evaluation.views[0].ssim + evaluation.views[1].ssim) / 2, 1e-12);
}

// Several views are measured at a time, each by a thread of its own.
TEST(Evaluate, GivesTheSameOnAnyNumberOfThreads) {
  const Gaussians gaussians = random_gaussians(kTypical, 50, random_camera(40, 30, 1), 3);
  std::vector<View> views = random_views(7, 40, 30);
  views[2].mask = Image8(40, 30, 1, 0);  // trains nowhere, and does not count
  views[4].exposure = Vec3f(0.5f);
  const auto renderer = make_scalar_renderer();
  std::vector<Evaluation> evaluations;
  for (const int threads : {1, 3, 16}) {
    std::vector<std::size_t> shown;
    const auto show = [&](std::size_t i, const View&, const ImageF&) { shown.push_back(i); };
    evaluations.push_back(with_threads(threads, [&] {
      return evaluate(*renderer, gaussians.span(), views, {}, show, MetricSet::all);
    }));
    EXPECT_THAT(shown, ElementsAre(0, 1, 2, 3, 4, 5, 6));
  }
  for (const Evaluation& evaluation : evaluations) {
    ASSERT_EQ(evaluation.views.size(), 6u);
    for (std::size_t i = 0; i < 6; ++i) {
      const ViewMetrics &view = evaluation.views[i], &first = evaluations[0].views[i];
      EXPECT_EQ(view.name, first.name);
      EXPECT_EQ(view.psnr, first.psnr);
      EXPECT_EQ(view.ssim_exposure, first.ssim_exposure);
      EXPECT_EQ(view.perceptual->flip, first.perceptual->flip);
    }
    EXPECT_EQ(evaluation.psnr, evaluations[0].psnr);
    EXPECT_TRUE(evaluation.has_exposures);
  }
  EXPECT_EQ(evaluations[0].views[2].name, "view 4");
}

TEST(Evaluate, OfNoViewsIsZero) {
  const auto renderer = make_scalar_renderer();
  const Evaluation evaluation = evaluate(*renderer, Gaussians().span(), {}, {});
  EXPECT_EQ(evaluation.psnr, 0);
  EXPECT_EQ(evaluation.ssim, 0);
}

TEST(Evaluate, ComparesPicturesUnderTheirExposuresToo) {
  const Gaussians gaussians = random_gaussians(kTypical, 50, random_camera(40, 30, 1), 3);
  const auto renderer = make_scalar_renderer();
  std::vector<View> views = {{"a", random_camera(40, 30, 1), Image8(40, 30, 3)},
                             {"b", random_camera(40, 30, 2), random_photo(40, 30, 2)}};
  views[0].exposure = {0.5f, 0.25f, 0.75f};
  evaluate(*renderer, gaussians.span(), views, {},
           [&](std::size_t i, const View&, const ImageF& picture) {
             if (i > 0) return;
             // the picture under these exposures
             for (std::size_t k = 0; k < picture.pixels.size(); ++k)
               views[0].photo.pixels[k] = std::uint8_t(
                   std::lround(255 * picture.pixels[k] * views[0].exposure[int(k % 3)]));
           });
  const Evaluation evaluation = evaluate(*renderer, gaussians.span(), views, {});
  EXPECT_TRUE(evaluation.has_exposures);
  EXPECT_LT(evaluation.views[0].psnr, 30);
  EXPECT_GT(evaluation.views[0].psnr_exposure, 50);  // except for rounding, and for values above 1
  EXPECT_GT(evaluation.views[0].ssim_exposure, 0.99);
  EXPECT_EQ(evaluation.views[1].psnr_exposure, evaluation.views[1].psnr);
  EXPECT_EQ(evaluation.psnr_exposure,
            evaluation.views[0].psnr_exposure / 2 + evaluation.views[1].psnr_exposure / 2);
  views[0].exposure = Vec3f(1);
  EXPECT_FALSE(evaluate(*renderer, gaussians.span(), views, {}).has_exposures);
}

}  // namespace
}  // namespace gs
