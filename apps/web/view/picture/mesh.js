// SPDX-License-Identifier: Apache-2.0
// The mesh of the model, over the right part of the picture.
import {
  BufferAttribute,
  BufferGeometry,
  DoubleSide,
  LinearFilter,
  Mesh,
  Scene,
  ShaderMaterial,
  Texture,
} from 'three';
import {readGlb} from './glb.js';

// What light makes of a gray surface: seen along its normal, and edge-on.
const BRIGHT = 0.9,
  DARK = 0.15;

// Attributes of three.js, and of glTF.
const NAMES = {position: 'POSITION', color: 'COLOR_0', uv: 'TEXCOORD_0'};

const vertexShader = `
#ifdef HAS_COLORS
attribute vec4 color;
#endif
varying vec3 vColor;
varying vec2 vPlace;
varying vec3 vView;
vec3 displayed(vec3 c) { // linear light to sRGB, as the page shows colors
  return mix(12.92 * c, 1.055 * pow(c, vec3(1.0 / 2.4)) - 0.055, step(0.0031308, c));
}
void main() {
#ifdef HAS_COLORS
  vColor = displayed(color.rgb);
#else
  vColor = vec3(0.7);
#endif
  vPlace = uv;
  vec4 view = modelViewMatrix * vec4(position, 1.0);
  vView = view.xyz;
  gl_Position = projectionMatrix * view;
}`;

const fragmentShader = `
uniform sampler2D picture;
uniform bool isShaded;
varying vec3 vColor;
varying vec2 vPlace;
varying vec3 vView;
void main() {
  vec3 color = vColor;
#ifdef HAS_TEXTURE
  color = texture2D(picture, vPlace).rgb;
#endif
  if (isShaded) {
    vec3 normal = normalize(cross(dFdx(vView), dFdy(vView)));
    color = vec3(mix(${DARK}, ${BRIGHT}, abs(dot(normal, normalize(vView)))));
  }
  gl_FragColor = vec4(color, 1.0);
}`;

export class MeshPicture {
  constructor(renderer, changed) {
    Object.assign(this, {renderer, changed, share: 0, look: 'color'});
    this.scene = new Scene();
    this.scene.rotation.z = Math.PI; // a .glb is turned, so that y points up
  }

  // bytes: ArrayBuffer of a .glb, as gemsplat writes meshes
  async load(bytes) {
    for (const {attributes, indices, image} of await readGlb(bytes)) {
      const geometry = new BufferGeometry();
      for (const [name, word] of Object.entries(NAMES)) {
        if (!attributes[word]) continue;
        const {rows, width, normalized} = attributes[word];
        geometry.setAttribute(name, new BufferAttribute(rows, width, normalized));
      }
      if (indices) geometry.setIndex(new BufferAttribute(indices.rows, 1));
      const picture = image && Object.assign(new Texture(image), {flipY: false, needsUpdate: true});
      if (picture) picture.minFilter = picture.magFilter = LinearFilter;
      const material = new ShaderMaterial({
        vertexShader,
        fragmentShader,
        side: DoubleSide,
        defines: {
          ...(geometry.getAttribute('color')?.itemSize === 4 && {HAS_COLORS: 1}),
          ...(picture && {HAS_TEXTURE: 1}),
        },
        uniforms: {picture: {value: picture}, isShaded: {value: false}},
      });
      const mesh = new Mesh(geometry, material);
      mesh.frustumCulled = false;
      this.scene.add(mesh);
    }
    this.setLook(this.look);
  }

  // 0 to 1: of the width of the picture.
  setShare(share) {
    this.share = share;
    this.changed();
  }

  // color, shaded or wires
  setLook(look) {
    this.look = look;
    for (const {material} of this.scene.children) {
      material.uniforms.isShaded.value = look !== 'color';
      material.wireframe = look === 'wires';
    }
    this.changed();
  }

  // Draws over a picture of `width` units: CSS pixels of the canvas, or pixels of a target.
  draw(camera, background, width, height, to = null) {
    if (this.share === 0 || !this.scene.children.length) return;
    const {renderer} = this,
      left = Math.round((1 - this.share) * width);
    if (to) {
      to.scissor.set(left, 0, width - left, height);
      to.scissorTest = true;
    } else {
      renderer.setScissor(left, 0, width - left, height);
      renderer.setScissorTest(true);
    }
    renderer.setRenderTarget(to);
    renderer.setClearColor(background, 1);
    renderer.clear();
    renderer.render(this.scene, camera);
    renderer.setScissorTest(false);
  }
}
