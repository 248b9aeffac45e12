// SPDX-License-Identifier: Apache-2.0
// The color ramp of depths: that of gs_app/pictures/color_ramp.cpp.

// Oklab (L, a, b) to sRGB.             Ottosson 2020, "A perceptual color space"
function srgbFromOklab(L, a, b) {
  const l = (L + 0.3963377774 * a + 0.2158037573 * b) ** 3,
    m = (L - 0.1055613458 * a - 0.0638541728 * b) ** 3,
    s = (L - 0.0894841775 * a - 1.291485548 * b) ** 3;
  return [
    4.0767416621 * l - 3.3077115913 * m + 0.2309699292 * s,
    -1.2684380046 * l + 2.6097574011 * m - 0.3413193965 * s,
    -0.0041960863 * l - 0.7034186147 * m + 1.707614701 * s,
  ].map(linear => {
    const v = Math.min(1, Math.max(0, linear));
    return Math.floor(255 * (v <= 0.0031308 ? 12.92 * v : 1.055 * v ** (1 / 2.4) - 0.055) + 0.5);
  });
}

/// 256 colors with even steps in lightness as RGBA: black, violet, red, orange, pale yellow.
export function rampBytes() {
  const bytes = new Uint8Array(4 * 256);
  for (let i = 0; i < 256; ++i) {
    const t = i / 255,
      hue = ((290 + 175 * t) * Math.PI) / 180;
    const chroma = 0.19 * Math.sin(Math.PI * Math.min(0.03 + 0.86 * t, 1)) ** 0.8;
    bytes.set(
      [...srgbFromOklab(0.08 + 0.89 * t, chroma * Math.cos(hue), chroma * Math.sin(hue)), 255],
      4 * i,
    );
  }
  return bytes;
}
