// SPDX-License-Identifier: Apache-2.0
#include "gs_core/math/view/view_splat.h"

#include "tests/support/scenes.h"

namespace gs {
namespace {

float rounded(float channel) { return unpacked_channel(packed_channel(channel)); }

TEST(ViewSplat, AChannelHasSeventeenSignificantBits) {
  Draws draws(1);
  for (int i = 0; i < 100'000; ++i) {
    const float channel = draws.log_uniform(0x1p-23f, 255.0f);
    EXPECT_LE(std::abs(double(rounded(channel)) - channel), 0x1p-17 * double(channel)) << channel;
  }
}

TEST(ViewSplat, SmallerChannelsAreOffByLittle) {
  Draws draws(2);
  for (int i = 0; i < 10'000; ++i) {
    const float channel = draws.log_uniform(1e-12f, 0x1p-23f);
    EXPECT_LE(std::abs(double(rounded(channel)) - channel), 0x1.1p-40) << channel;  // half a step
  }
}

TEST(ViewSplat, ChannelsBeyondTheRangeAreClamped) {
  EXPECT_EQ(rounded(-1.0f), 0);
  EXPECT_EQ(rounded(0.0f), 0);
  EXPECT_EQ(rounded(-0.0f), 0);
  EXPECT_EQ(rounded(kMostChannel), kMostChannel);
  EXPECT_EQ(rounded(1e30f), kMostChannel);
  EXPECT_EQ(packed_channel(1e30f), (1u << kChannelBits) - 1);
}

TEST(ViewSplat, RoundNumbersAreExact) {
  for (const float channel : {1.0f, 0.5f, 0.75f, 2.0f, 100.0f, 0x1p-20f})
    EXPECT_EQ(rounded(channel), channel);
}

TEST(ViewSplat, ColorsKeepTheirChannelsApart) {
  const float most = kMostChannel;
  for (const Vec3f color : {Vec3f(most, 0, 0), Vec3f(0, most, 0), Vec3f(0, 0, most),
                            Vec3f(0.25f, 0.5f, 0.125f), Vec3f(-3, 1, -1)}) {
    const Vec3f actual = unpacked_color(packed_color(color));
    for (int c = 0; c < 3; ++c) EXPECT_EQ(actual[c], max_of(color[c], 0.0f));
  }
}

struct ShapedSplat {
  Splat splat;  // gray
  Sym2<float> cov2d;
  std::size_t row;
};

std::vector<ShapedSplat> visible_splats(const Recipe& recipe, std::size_t count,
                                        const Camera& camera) {
  const Gaussians rows = random_gaussians(recipe, count, camera, 4);
  std::vector<ShapedSplat> shaped;
  for (std::size_t i = 0; i < rows.count(); ++i) {
    const auto projected = project_shape(camera, rows.mean[i], rows.log_scale[i], rows.rotation[i],
                                         rows.logit_opacity[i], 0.0f, SplatSettings());
    if (!projected.is_visible) continue;
    shaped.push_back({projected.splat, projected.cov2d, i});
    shaped.back().splat.color = {0.5f, 0.5f, 0.5f};
  }
  return shaped;
}

// The rounding of three products and a sum, where the covariance is not that of a long needle.
TEST(ViewSplat, ItsOutlineIsThatOfItsSplat) {
  const Camera camera = random_camera(160, 120, 3);
  for (const Recipe& recipe : {kTypical, kHuge, kFaint, kOpaque}) {
    for (const ShapedSplat& shaped : visible_splats(recipe, 2000, camera)) {
      const SplatOutline a = outline_of(view_splat(shaped.splat)), b = outline_of(shaped.splat);
      EXPECT_EQ(a.mean2d, b.mean2d);
      const float largest = max_of(b.conic.xx, b.conic.yy);
      EXPECT_NEAR(a.conic.xx, b.conic.xx, 2e-6f * largest);
      EXPECT_NEAR(a.conic.xy, b.conic.xy, 2e-6f * largest);
      EXPECT_NEAR(a.conic.yy, b.conic.yy, 2e-6f * largest);
      EXPECT_NEAR(a.cutoff, b.cutoff, 1e-6f * max_of(b.cutoff, 1.0f));
    }
  }
}

// Blending evaluates a packed splat by its factors; each fragment that it keeps lies in a tile and
// a part that the packed outline lists.
template <int edge>
void expect_no_lost_fragment() {
  const Camera camera = random_camera(640, 480, 3);
  const int tiles_x = (camera.width + edge - 1) / edge, tiles_y = (camera.height + edge - 1) / edge;
  std::size_t fragments = 0;
  for (const Recipe& recipe : {kTypical, kSharp, kNeedles}) {
    for (const auto& [splat, cov2d, i] : visible_splats(recipe, 300, camera)) {
      const ViewSplat packed = view_splat(splat);
      const SplatOutline outline = outline_of(packed);
      const Rect tiles =
          tile_rect<edge>(pixel_rect<edge>(splat.mean2d, cov2d, splat.cutoff, tiles_x, tiles_y));
      for (int y = tiles.y_begin * edge; y < tiles.y_end * edge; ++y) {
        const int row = y / edge;
        const TileSpan span =
            hit_tiles_of_row<edge>(outline.mean2d, outline.conic, outline.cutoff, tiles, row);
        const PartSpans<edge> parts =
            hit_parts_of_row<edge>(outline.mean2d, outline.conic, outline.cutoff, row);
        for (int x = tiles.x_begin * edge; x < tiles.x_end * edge; ++x) {
          const double dx = x + 0.5 - splat.mean2d.x, dy = y + 0.5 - splat.mean2d.y;
          const double u_x = packed.L.xx * dx + packed.L.xy * dy, u_y = packed.L.yy * dy;
          if (packed.log2_opacity - u_x * u_x - u_y * u_y < 0) continue;
          constexpr int kAcross = kPartsAcross<edge>;
          const int tile = x / edge, part = x / kPart % kAcross + kAcross * (y / kPart % kAcross);
          ASSERT_TRUE(tile >= span.begin && tile < span.end) << i << ": " << x << ", " << y;
          ASSERT_TRUE(parts.parts_of(tile) >> part & 1) << i << ": " << x << ", " << y;
          ++fragments;
        }
      }
    }
  }
  EXPECT_GT(fragments, 10'000u);
}
TEST(ViewSplat, TilesOfItsOutlineLoseNoFragment) {
  expect_no_lost_fragment<kTileWidth>();
  expect_no_lost_fragment<kWideTile>();
}

}  // namespace
}  // namespace gs
