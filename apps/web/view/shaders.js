// SPDX-License-Identifier: Apache-2.0
// Changes to Spark's shaders that make it evaluate the same equation as gemsplat
// (docs/equations.md).

// The Jacobian is evaluated no farther out than this (1 is the edge of the picture):
// kFrustumMargin.
const JACOBIAN_LIMIT = '1.3';

// [a line of Spark's vertex shader, its replacement]
const CHANGES = [
  // Clamp the Jacobian's x/z and y/z to the limit.
  ['vec2 J2 = -(J1 * viewCenter.xy) * invZ;',
   `vec2 slope = -(clamp(clipCenter.xy / clipCenter.w, -${JACOBIAN_LIMIT}, ${JACOBIAN_LIMIT})
        + vec2(projectionMatrix[2][0], projectionMatrix[2][1])) / vec2(projectionMatrix[0][0], projectionMatrix[1][1]);
    vec2 J2 = -J1 * slope;`],
  // End a splat where its alpha falls below minAlpha.
  ['adjustedStdDev = maxStdDev;',
   'adjustedStdDev = min(maxStdDev, sqrt(2.0 * log(max(rgba.a / minAlpha, 1.0))));'],
];

/// Spark's vertex shader with the changes. Throws Error if a line to be replaced is not in it
/// exactly once.
export function vertexShader(text) {
  return CHANGES.reduce((shader, [from, to]) => {
    if (shader.split(from).length !== 2) throw new Error(`Spark's vertex shader has changed: "${from}" was expected in it once`);
    return shader.replace(from, to);
  }, text);
}

/// One fragment: alpha = opacity exp(-|u|^2 / 2), discarded below minAlpha. The color is not
/// converted.
export const fragmentShader = `
precision highp float;
uniform float minAlpha;
in vec4 vRgba;
in vec2 vSplatUv;  // in standard deviations
out vec4 fragColor;
void main() {
  float alpha = vRgba.a * exp(-0.5 * dot(vSplatUv, vSplatUv));
  if (alpha < minAlpha) discard;
  fragColor = vec4(vRgba.rgb * alpha, alpha);
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
void main() {
  vec4 sum = texture2D(gathered, place);
  gl_FragColor = vec4(sum.rgb + (1.0 - sum.a) * background, 1.0);
}`;
