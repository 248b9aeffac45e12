// SPDX-License-Identifier: Apache-2.0
// Changes to Spark's shaders that make it evaluate the same equation as gemsplat
// (docs/method/equations.md).
import {Matrix3, Matrix4, Vector3} from 'three';
import {lookShader} from './look.js';

// The Jacobian is evaluated no farther out than this (1 is the edge of the picture):
// kFrustumMargin.
const JACOBIAN_LIMIT = '1.3';
/// No Gaussian is so large.   world units
export const NO_SIZE = 1e30;

// [a line of Spark's vertex shader, its replacement]
const CHANGES = [
  // Clamp the Jacobian's x/z and y/z to the limit.
  [
    'vec2 J2 = -(J1 * viewCenter.xy) * invZ;',
    `vec2 slope = -(clamp(clipCenter.xy / clipCenter.w, -${JACOBIAN_LIMIT}, ${JACOBIAN_LIMIT})
        + vec2(projectionMatrix[2][0], projectionMatrix[2][1])) / vec2(projectionMatrix[0][0], projectionMatrix[1][1]);
    vec2 J2 = -J1 * slope;`,
  ],
  // End a splat where its alpha falls below minAlpha.
  [
    'adjustedStdDev = maxStdDev;',
    'adjustedStdDev = min(maxStdDev, sqrt(2.0 * log(max(rgba.a / minAlpha, 1.0))));',
  ],
  // What tools ask for: the depth of a splat, the size of splats, points, a crop, a filter.
  [
    'out vec3 vNdc;',
    `out vec3 vNdc;
out float vDepth;
uniform float splatScale;
uniform float pointRadius;
uniform int cropKind;
uniform bool cropDrops;
uniform vec3 cropLow;
uniform vec3 cropHigh;
uniform mat3 cropTurn;
uniform mat4 worldFromView;
uniform float filterOpacity;
uniform float filterSize;
bool isCropped(vec3 mean) {
    if (cropKind == 0) return false;
    vec3 turned = cropTurn * mean;
    bool isInside = cropKind == 1 ? all(greaterThanEqual(turned, cropLow)) && all(lessThanEqual(turned, cropHigh))
                                  : distance(mean, cropLow) <= cropHigh.x;
    return isInside == cropDrops;
}`,
  ],
  [
    'if (viewCenter.z >= 0.0) {',
    `vDepth = -viewCenter.z;
    if (isCropped((worldFromView * vec4(viewCenter, 1.0)).xyz)) return;
    if (rgba.a <= filterOpacity) return;
    if (!enableCovSplats && max(scales.x, max(scales.y, scales.z)) >= filterSize) return;
    if (viewCenter.z >= 0.0) {`,
  ],
  [
    'mat3 RS = scaleQuaternionToMatrix(scales, viewQuaternion);',
    'mat3 RS = scaleQuaternionToMatrix(splatScale * scales, viewQuaternion);',
  ],
  [
    'float scale2 = min(maxPixelRadius, adjustedStdDev * sqrt(eigen2));',
    `float scale2 = min(maxPixelRadius, adjustedStdDev * sqrt(eigen2));
    if (pointRadius > 0.0) {
        scale1 = scale2 = pointRadius;
        vSplatUv = position.xy;
        vRgba.a = 1.0;
    }`,
  ],
];

/// The uniforms that these changes read. Kinds of crops: 0 none, 1 a box between two corners of the
/// world under cropTurn, 2 a sphere about cropLow with the radius cropHigh.x. A filter hides what has at
/// most that opacity, and what is at least as large in world units.
export const effectUniforms = () => ({
  splatScale: {value: 1},
  pointRadius: {value: 0},
  showsDepth: {value: false},
  cropKind: {value: 0},
  cropDrops: {value: false},
  cropLow: {value: new Vector3()},
  cropHigh: {value: new Vector3()},
  cropTurn: {value: new Matrix3()},
  worldFromView: {value: new Matrix4()},
  filterOpacity: {value: 0},
  filterSize: {value: NO_SIZE},
});

/// Spark's vertex shader with the changes. Throws Error if a line to be replaced is not in it
/// exactly once.
export function vertexShader(text) {
  return CHANGES.reduce((shader, [from, to]) => {
    if (shader.split(from).length !== 2)
      throw new Error(`Spark's vertex shader has changed: "${from}" was expected in it once`);
    return shader.replace(from, to);
  }, text);
}

/// One fragment: alpha = opacity exp(-|u|^2 / 2), discarded below minAlpha. The color is not
/// converted. A depth takes its place where depths are summed; a point is a disc.
export const fragmentShader = `
precision highp float;
uniform float minAlpha;
uniform float pointRadius;
uniform bool showsDepth;
in vec4 vRgba;
in vec2 vSplatUv;  // in standard deviations
in float vDepth;
out vec4 fragColor;
void main() {
  float u2 = dot(vSplatUv, vSplatUv);
  float alpha = pointRadius > 0.0 ? (u2 > 1.0 ? 0.0 : vRgba.a) : vRgba.a * exp(-0.5 * u2);
  if (alpha < minAlpha) discard;
  fragColor = vec4((showsDepth ? vec3(vDepth, 0.0, 0.0) : vRgba.rgb) * alpha, alpha);
}`;

/// The sum of all splats over the background.
export const compositeVertexShader = `
varying vec2 place;
void main() {
  place = uv;
  gl_Position = vec4(position.xy, 0.0, 1.0);
}`;
export const compositeFragmentShader = `
uniform sampler2D gathered;
uniform vec3 background;
varying vec2 place;
${lookShader}
void main() {
  vec4 sum = texture2D(gathered, place);
  gl_FragColor = vec4(shown(sum.rgb + (1.0 - sum.a) * background), 1.0);
}`;
