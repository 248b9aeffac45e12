// SPDX-License-Identifier: Apache-2.0
// One fragment: exponent, alpha, compositing; and the gradient of a whole pixel, front to back.
#include "gs_core/math/render/blend.h"

#include "tests/support/jet_oracle.h"

namespace gs {
namespace {

/// The conic of a splat with standard deviations of 0.5 to 300 pixels: round ones and needles.
Sym2<double> draw_conic(TestRandom& random) {
  const double a = std::pow(10.0, random.uniform(-5.0, 0.6)),
               b = std::pow(10.0, random.uniform(-5.0, 0.6));
  const double angle = random.uniform(0.0, 3.2), c = std::cos(angle), s = std::sin(angle);
  return {a * c * c + b * s * s, (a - b) * c * s, a * s * s + b * c * c};
}

// d = (2, -1), Q = [0.5 0.25; 0.25 1]: d^T Q d = 0.5*4 - 2*0.25*2 + 1 = 2.
TEST(FragmentExponent, IsTheHandValue) {
  EXPECT_DOUBLE_EQ(fragment_exponent(Sym2<double>{0.5, 0.25, 1.0}, 2.0, -1.0), -1.0);
}

TEST(FragmentExponent, GradientMatchesJet) {
  double pixel_x = 0.0, pixel_y = 0.0;
  const double worst = worst_gradient_error(
      [&](const auto& x) {
        using T = std::decay_t<decltype(x[0])>;
        Unflatten in(x);
        const Sym2<T> conic = in.sym2();
        const Vec2<T> mean = in.vec2();
        return flatten(fragment_exponent(conic, T(pixel_x) - mean.x, T(pixel_y) - mean.y));
      },
      [&](const auto& x, const auto& g) {
        Unflatten in(x);
        const Sym2<double> conic = in.sym2();
        const Vec2<double> mean = in.vec2();
        const auto dL = fragment_exponent_vjp(conic, pixel_x - mean.x, pixel_y - mean.y, g[0]);
        return flatten(by_stored_entry(dL.conic), dL.mean2d);
      },
      [&](TestRandom& random) {
        pixel_x = random.uniform(0.0, 50.0);
        pixel_y = random.uniform(0.0, 50.0);
        return flatten(draw_conic(random), random.uniform(0.0, 50.0), random.uniform(0.0, 50.0));
      });
  EXPECT_LT(worst, kJetTolerance);
}

// ---- log2(alpha) as a product.

/// A covariance with standard deviations of 0.55 to 400 pixels: round ones and needles, and its
/// conic.
struct Shape {
  Sym2<double> cov2d, conic;
};
Shape draw_shape(TestRandom& random) {
  const double a = std::pow(10.0, random.uniform(-0.5, 5.2)),
               b = std::pow(10.0, random.uniform(-0.5, 5.2));
  const double angle = random.uniform(0.0, 3.2), c = std::cos(angle), s = std::sin(angle);
  const Sym2<double> S{a * c * c + b * s * s, (a - b) * c * s, a * s * s + b * c * c};
  // The conic comes from its own eigenvalues, because the inverse of S would lose the digits that
  // are tested here.
  return {S, {c * c / a + s * s / b, (1 / a - 1 / b) * c * s, s * s / a + c * c / b}};
}

ConicFactors<double> factors_of(const Shape& shape) {
  return conic_factors(shape.conic, shape.cov2d.yy);
}

TEST(ConicFactors, MultiplyToTheConic) {
  TestRandom random;
  for (int i = 0; i < 10'000; ++i) {
    const Shape shape = draw_shape(random);
    const ConicFactors<double> L = factors_of(shape);
    const Sym2<double> Q = conic_of(L);
    const double size = shape.conic.xx + shape.conic.yy;
    EXPECT_NEAR(Q.xx, shape.conic.xx, 1e-12 * size);
    EXPECT_NEAR(Q.xy, shape.conic.xy, 1e-12 * size);
    EXPECT_NEAR(Q.yy, shape.conic.yy, 1e-12 * size);
  }
}

// Means up to 2,000 pixels away, as at the far end of a needle. Rounding is relative to the terms
// of the sum.
TEST(ExponentCoefficients, TimesMonomialsAreLog2OfAlpha) {
  TestRandom random;
  double worst = 0;
  for (int i = 0; i < 100'000; ++i) {
    const ConicFactors<double> L = factors_of(draw_shape(random));
    const double reach = std::pow(10.0, random.uniform(0.0, 3.3));
    const Vec2<double> mean{random.uniform(-reach, reach), random.uniform(-reach, reach)};
    const double x = random.uniform(-8.0, 8.0), y = random.uniform(-8.0, 8.0);
    const double opacity = random.uniform(1.0 / 255.0, 1.0);
    // The original exponent: E = -1/2 d^T Q d with the conic that the factors stand for.
    const Sym2<double> Q = conic_of(L);
    const double dx = x - mean.x, dy = y - mean.y;
    const double E = -0.5 * (Q.xx * dx * dx + Q.yy * dy * dy) - Q.xy * dx * dy;
    const auto coefficients = exponent_coefficients(L, mean, std::log2(opacity));
    const auto monomials = pixel_monomials(x, y);
    double size = 1 + Q.xx * dx * dx + Q.yy * dy * dy;
    for (int k = 0; k < kExponentTerms; ++k) size += std::abs(coefficients.of[k] * monomials.of[k]);
    const double error = inner(coefficients, monomials) - (std::log2(opacity) + kLog2E * E);
    worst = std::max(worst, std::abs(error) / size);
  }
  EXPECT_LT(worst, 1e-12);
}

TEST(PixelMonomials, AboutATileCenterFitElevenBits) {
  for (int y = 0; y < 16; ++y)
    for (int x = 0; x < 16; ++x)
      for (const double term : pixel_monomials(x - 7.5, y - 7.5).of)
        EXPECT_TRUE(4 * term == std::round(4 * term) && std::abs(4 * term) < 2048);
}

// Along a needle of 300 pixels the terms of E cancel, and rounding alone could raise it above 0.
TEST(FragmentExponent, IsNeverAboveZeroInFloat) {
  TestRandom random;
  for (int i = 0; i < 100'000; ++i) {
    const double angle = random.uniform(0.0, 3.2), c = std::cos(angle), s = std::sin(angle);
    const double thin = 4.0, length = random.uniform(-300.0, 300.0);
    const Sym2<float> conic{float(thin * s * s), float(-thin * c * s), float(thin * c * c)};
    EXPECT_LE(fragment_exponent(conic, float(length * c), float(length * s)), 0.0f);
  }
}

TEST(FragmentExponent, IsClampedToZeroForAnIndefiniteConic) {
  EXPECT_EQ(fragment_exponent(Sym2<float>{-1.0f, 0.0f, -1.0f}, 3.0f, 2.0f), 0.0f);
  EXPECT_EQ(fragment_exponent(Sym2<float>{1.0f, -5.0f, 1.0f}, 1.0f, 1.0f), 0.0f);
}

// Every 64th float from -1e-9 down to -80. The truncated series is wrong by up to 1.2e-7, and rounding
// adds as much: 2.6e-7 over all floats.
TEST(ExpFragment, IsWithinThreeTenMillionthsOfExpNeverAboveOneAndFalls) {
  double worst = 0.0;
  float largest = 0.0f;
  int rise = 0;  // to the next smaller float, in units in the last place
  const std::uint32_t last = std::bit_cast<std::uint32_t>(-80.0f);
  for (std::uint32_t bits = std::bit_cast<std::uint32_t>(-1e-9f); bits <= last; bits += 64) {
    const float x = std::bit_cast<float>(bits), found = exp_fragment(x);
    const double expected = std::exp(double(x));
    worst = std::max(worst, std::abs(found - expected) / expected);
    largest = std::max(largest, found);
    rise = std::max(rise, std::bit_cast<std::int32_t>(exp_fragment(std::nextafter(x, -100.0f))) -
                              std::bit_cast<std::int32_t>(found));
  }
  EXPECT_LT(worst, 3e-7);
  EXPECT_LE(largest, 1.0f);
  EXPECT_LE(rise, 1);
}

TEST(ExpFragment, IsExactlyOneAtZero) {
  EXPECT_EQ(exp_fragment(0.0f), 1.0f);
  EXPECT_EQ(exp_fragment(-0.0f), 1.0f);
}

TEST(ExpFragment, IsExpInDouble) {
  for (double x = -80.0; x <= 0.0; x += 0.37) EXPECT_EQ(exp_fragment(x), std::exp(x));
}

TEST(FragmentAlpha, IsClampedUnderTheClassicRuleOnly) {
  EXPECT_EQ((fragment_alpha<BlendRule::classic>(1.0f, 0.995f)), 0.99f);
  EXPECT_EQ((fragment_alpha<BlendRule::faster_gs>(1.0f, 0.995f)), 0.995f);
  EXPECT_EQ((fragment_alpha<BlendRule::classic>(0.5f, 0.5f)), 0.25f);
}

template <BlendRule rule>
double worst_alpha_error(int& below, int& above) {
  return worst_gradient_error(
      [](const auto& x) { return flatten(fragment_alpha<rule>(x[0], exp_fragment(x[1]))); },
      [](const auto& x, const auto& g) {
        const auto dL = fragment_alpha_vjp<rule>(x[0], exp_fragment(x[1]), g[0]);
        return flatten(dL.opacity, dL.exponent);
      },
      [&](TestRandom& random) {
        const double opacity = random.uniform(0.97, 1.0), exponent = random.uniform(-0.02, 0.0);
        (opacity * std::exp(exponent) > double(kMaxAlphaClassic) ? above : below) += 1;
        return flatten(opacity, exponent);
      });
}

TEST(FragmentAlpha, GradientMatchesJetOnBothSidesOfTheClassicClamp) {
  int below = 0, above = 0;
  EXPECT_LT(worst_alpha_error<BlendRule::classic>(below, above), kJetTolerance);
  EXPECT_LT(worst_alpha_error<BlendRule::faster_gs>(below, above), kJetTolerance);
  EXPECT_GT(std::min(below, above), 2 * kEnoughCases);  // in both runs together
}

TEST(Transmittance, IsOpaqueBelowOneTenThousandth) {
  EXPECT_FALSE(is_opaque(1e-4f));
  EXPECT_TRUE(is_opaque(std::nextafter(1e-4f, 0.0f)));
}

// Half of red, then half of the rest blue: (0.5, 0, 0.25), and a quarter passes.
TEST(Composite, IsTheHandValue) {
  PixelState<double> pixel;
  composite(pixel, Vec3d{1.0, 0.0, 0.0}, 0.5);
  composite(pixel, Vec3d{0.0, 0.0, 1.0}, 0.5);
  EXPECT_EQ(flatten(pixel.color), (std::array{0.5, 0.0, 0.25}));
  EXPECT_EQ(pixel.transmittance, 0.25);
}

TEST(Composite, TakesNegativeChannelsForBlack) {
  PixelState<double> pixel;
  composite(pixel, Vec3d{-1.0, 0.5, -0.1}, 0.5);
  EXPECT_EQ(flatten(pixel.color), (std::array{0.0, 0.25, 0.0}));
}

// ---- A pixel of several fragments over a background, as a function of all their colors and alphas.

constexpr std::size_t kFragments = 8;

template <class T>
struct Pixel {
  std::array<Vec3<T>, kFragments> colors;
  std::array<T, kFragments> alphas;
};
template <class T, std::size_t N>
Pixel<T> read_pixel(const std::array<T, N>& flat) {
  Unflatten in(flat);
  Pixel<T> pixel{in.template vec3s<kFragments>(), {}};
  for (T& alpha : pixel.alphas) alpha = in.scalar();
  return pixel;
}
template <class T>
PixelState<T> blend(const Pixel<T>& pixel) {
  PixelState<T> state;
  for (std::size_t i = 0; i < kFragments; ++i) composite(state, pixel.colors[i], pixel.alphas[i]);
  return state;
}
template <class T>
Vec3<T> over(const PixelState<T>& pixel, const Vec3d& background) {
  return pixel.color +
         pixel.transmittance * Vec3<T>{T(background.x), T(background.y), T(background.z)};
}
template <class T>
Pixel<T> blend_vjp(const Pixel<T>& pixel, const Vec3<T>& background, const Vec3<T>& dL_dcolor) {
  const PixelState<T> final = blend(pixel);
  PixelBackwardState<T> state{final.color, T(1), dL_dcolor,
                              -final.transmittance * inner(dL_dcolor, background)};
  Pixel<T> grads;
  for (std::size_t i = 0; i < kFragments; ++i) {
    const auto dL = composite_vjp(state, pixel.colors[i], pixel.alphas[i]);
    grads.colors[i] = dL.color;
    grads.alphas[i] = dL.alpha;
  }
  return grads;
}

TEST(CompositeGradient, OfAWholePixelMatchesJetOnBothSidesOfTheColorClamp) {
  Vec3d background;
  int negative = 0, zero = 0, positive = 0, nearly_opaque = 0;
  const double worst = worst_gradient_error(
      [&](const auto& x) { return flatten(over(blend(read_pixel(x)), background)); },
      [&](const auto& x, const auto& g) {
        const Pixel<double> grads = blend_vjp(read_pixel(x), background, Unflatten(g).vec3());
        return flatten(grads.colors, grads.alphas);
      },
      [&](TestRandom& random) {
        background = random.uniform3(0.0, 1.0);
        Pixel<double> pixel;
        for (Vec3d& color : pixel.colors) {
          color = random.uniform3(-0.5, 1.5);
          if (random.chance(0.1)) color.x = 0.0;  // passes its gradient, like every c >= 0
          negative += color.x < 0.0;
          zero += color.x == 0.0;
          positive += color.x > 0.0;
        }
        for (double& alpha : pixel.alphas) {
          alpha = random.chance(0.15) ? random.uniform(0.9, 0.999) : random.uniform(0.004, 0.6);
          nearly_opaque += alpha > 0.99;
        }
        return flatten(pixel.colors, pixel.alphas);
      });
  EXPECT_LT(worst, kJetTolerance);
  EXPECT_GT(std::min({negative, zero, positive, nearly_opaque}), kEnoughCases);
}

// Sums of weights times depths, the depths in the place of red.
TEST(CompositeGradient, OfDepthsMatchesJet) {
  const auto depth_of = [](const auto& x) {
    const auto pixel = read_pixel(x);
    using T = std::decay_t<decltype(pixel.alphas[0])>;
    T transmittance(1), sum(0);
    for (std::size_t i = 0; i < kFragments; ++i) {
      sum += transmittance * pixel.alphas[i] * pixel.colors[i].x;
      transmittance *= T(1) - pixel.alphas[i];
    }
    return std::array<T, 1>{sum};
  };
  const double worst = worst_gradient_error(
      depth_of,
      [&](const auto& x, const auto& g) {
        const Pixel<double> pixel = read_pixel(x);
        DepthBackwardState<double> state{depth_of(x)[0], g[0]};
        double transmittance = 1;
        Pixel<double> grads;
        for (std::size_t i = 0; i < kFragments; ++i) {
          const DepthCompositeGradient<double> dL =
              composite_depth_vjp(state, transmittance, pixel.colors[i].x, pixel.alphas[i]);
          grads.colors[i] = {dL.depth, 0, 0};
          grads.alphas[i] = dL.alpha;
          transmittance *= 1 - pixel.alphas[i];
        }
        return flatten(grads.colors, grads.alphas);
      },
      [&](TestRandom& random) {
        Pixel<double> pixel;
        for (Vec3d& color : pixel.colors) color = {random.uniform(0.3, 9), 0, 0};
        for (double& alpha : pixel.alphas) alpha = random.uniform(0.004, 0.99);
        return flatten(pixel.colors, pixel.alphas);
      });
  EXPECT_LT(worst, kJetTolerance);
}

TEST(CompositeGradient, StaysFiniteForAnAlphaOfExactlyOne) {
  Pixel<float> pixel;
  pixel.colors.fill({0.3f, 0.7f, 0.1f});
  pixel.alphas.fill(0.2f);
  pixel.alphas[3] = 1.0f;
  const Pixel<float> grads = blend_vjp(pixel, Vec3f{1.0f, 1.0f, 1.0f}, Vec3f{1.0f, -1.0f, 0.5f});
  for (const float g : flatten(grads.colors, grads.alphas)) EXPECT_TRUE(std::isfinite(g));
}

// A fragment with alpha 1 hides everything behind it, so dL/dalpha there is <T c, g> alone.
TEST(CompositeGradient, IsExactForAnAlphaOfExactlyOneInDouble) {
  Pixel<double> pixel;
  pixel.colors.fill({0.25, 0.5, 0.125});
  pixel.alphas.fill(0.25);
  pixel.alphas[1] = 1.0;
  const Pixel<double> grads = blend_vjp(pixel, Vec3d{1.0, 1.0, 1.0}, Vec3d{1.0, 1.0, 1.0});
  EXPECT_DOUBLE_EQ(grads.alphas[1], 0.75 * (0.25 + 0.5 + 0.125));
  EXPECT_EQ(grads.alphas[2], 0.0);
}

}  // namespace
}  // namespace gs
