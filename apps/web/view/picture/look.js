// SPDX-License-Identifier: Apache-2.0
// The look of a photo: what a learned photometric model makes of the scene's colors there
// (docs/photometric.md). The server sends the numbers of each camera's photo.
import {Matrix3, Vector2, Vector3} from 'three';

const COLOR_SUM_EPSILON = '1e-5';  // kColorSumEpsilon of gs_core/math/ppisp.h

export const lookUniforms = () => ({
  hasLook: {value: false}, lookGain: {value: new Vector3(1, 1, 1)}, lookVignetting: {value: new Vector3()}, lookMixes: {value: false},
  lookMatrix: {value: new Matrix3()}, lookFactors: {value: new Vector3(1, 1, 1)}, lookCenter: {value: new Vector2()}, lookReach: {value: new Vector2(1, 1)}, lookMost: {value: 1}});

/// look: {gain: [r, g, b], vignetting: [b1, b2, b3], matrix: 9 numbers by rows, factors: 3}, the
/// latter two with the model ppisp alone; null: none
export function setLook(uniforms, look) {
  uniforms.hasLook.value = look !== null;
  if (!look) return;
  uniforms.lookGain.value.set(...look.gain);
  uniforms.lookVignetting.value.set(...look.vignetting);
  uniforms.lookMixes.value = Boolean(look.matrix);
  if (!look.matrix) return;
  uniforms.lookMatrix.value.set(...look.matrix);
  uniforms.lookFactors.value.set(...look.factors);
}

/// Vignetting is about the principal point; rho is 1 half a diagonal away from it, and not larger
/// around the picture than in its farthest corner. lens: of the window, with the picture's place in it
export function placeLook(uniforms, {width, height, cx, cy, picture}) {
  const {left, top, width: w, height: h} = picture ?? {left: 0, top: 0, width, height}, reach = Math.hypot(w, h) / 2;
  uniforms.lookMost.value = (Math.hypot(Math.max(cx - left, left + w - cx), Math.max(cy - top, top + h - cy)) / reach) ** 2;
  uniforms.lookCenter.value.set(cx / width, 1 - cy / height);
  uniforms.lookReach.value.set(width / reach, height / reach);
}

/// shown(color, place): what the photo shows of a color; place: 0 to 1 across the window, y up.
///
///   y = gain exp(-B) f M (k o x),   f = (sum x + eps) / (sum k o x + eps)
///   B = b1 P1 + b2 P2 + b3 P3 at rho, the squared distance from the principal point
export const lookShader = `
uniform bool hasLook;
uniform bool lookMixes;
uniform vec3 lookGain;
uniform vec3 lookVignetting;
uniform mat3 lookMatrix;
uniform vec3 lookFactors;
uniform vec2 lookCenter;
uniform vec2 lookReach;
uniform float lookMost;
vec3 shown(vec3 color, vec2 place) {
  if (!hasLook) return color;
  vec2 away = (place - lookCenter) * lookReach;
  float s = 2.0 * min(dot(away, away), lookMost) - 1.0, s2 = s * s;
  float lens = exp(-dot(lookVignetting, vec3(s, 0.5 * (3.0 * s2 - 1.0), 0.5 * s * (5.0 * s2 - 3.0))));
  if (lookMixes) {
    vec3 z = lookFactors * color;
    float f = (color.r + color.g + color.b + ${COLOR_SUM_EPSILON}) / (z.r + z.g + z.b + ${COLOR_SUM_EPSILON});
    color = f * (lookMatrix * z);
  }
  return lens * lookGain * color;
}`;
