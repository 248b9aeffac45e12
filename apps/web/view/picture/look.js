// SPDX-License-Identifier: Apache-2.0
// The look of a photo: what a learned photometric model makes of the scene's colors there
// (docs/method/photometric.md). The server sends the numbers of each camera's photo.
import {Vector3} from 'three';

export const lookUniforms = () => ({
  hasLook: {value: false},
  lookGain: {value: new Vector3(1, 1, 1)},
});

/// look: {gain: [r, g, b]}; null: none
export function setLook(uniforms, look) {
  uniforms.hasLook.value = look !== null;
  if (look) uniforms.lookGain.value.set(...look.gain);
}

/// shown(color): what the photo shows of a color.
export const lookShader = `
uniform bool hasLook;
uniform vec3 lookGain;
vec3 shown(vec3 color) {
  return hasLook ? lookGain * color : color;
}`;
