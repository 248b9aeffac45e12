// SPDX-License-Identifier: Apache-2.0
// Depth and normals as `gemsplat render` defines them (docs/reference/rendering.md): the mean depth
// of a pixel's fragments, and the normal of the surface that the depth picture shows.
import {
  DataTexture,
  FloatType,
  HalfFloatType,
  LinearFilter,
  Mesh,
  NearestFilter,
  OrthographicCamera,
  PlaneGeometry,
  RGBAFormat,
  Scene,
  ShaderMaterial,
  Vector2,
  Vector4,
  WebGLRenderTarget,
} from 'three';
import {compositeVertexShader} from './shaders.js';
import {rampBytes} from './ramp.js';

const SAMPLE = 64; // pixels of a side: depths from which the range of the ramp is taken
const OUTLIERS = 0.01; // of the depths, at either end
const SEEN = 0.5; // alpha from which a pixel counts as something to measure at

const depthShader = `
uniform sampler2D gathered;
float depthAt(ivec2 pixel) {
  ivec2 size = textureSize(gathered, 0);
  if (any(lessThan(pixel, ivec2(0))) || any(greaterThanEqual(pixel, size))) return 0.0;
  vec4 sum = texelFetch(gathered, pixel, 0);
  return sum.a < 1.0 / 255.0 ? 0.0 : sum.r / sum.a;
}`;

const fragmentShader = `
precision highp float;
precision highp sampler2D;
${depthShader}
uniform sampler2D ramp;
uniform bool showsNormals;
uniform vec2 range;   // 1 / depth: at the far end of the ramp, and at the near end
uniform vec4 lens;    // fx, fy, cx, cy in pixels of this picture, y down
varying vec2 place;
vec3 pointAt(ivec2 pixel) {
  float z = depthAt(pixel), y = float(textureSize(gathered, 0).y) - 0.5 - float(pixel.y);
  return vec3((float(pixel.x) + 0.5 - lens.z) / lens.x * z, (y - lens.w) / lens.y * z, z);
}
// Between the neighbors along an axis; the pixel itself replaces one without a depth.
vec3 difference(ivec2 pixel, ivec2 by) {
  ivec2 ahead = depthAt(pixel + by) > 0.0 ? pixel + by : pixel, behind = depthAt(pixel - by) > 0.0 ? pixel - by : pixel;
  return pointAt(ahead) - pointAt(behind);
}
void main() {
  ivec2 pixel = ivec2(gl_FragCoord.xy);
  float z = depthAt(pixel);
  vec3 color = vec3(0.0);
  if (z > 0.0 && showsNormals) {
    vec3 n = cross(difference(pixel, ivec2(0, -1)), difference(pixel, ivec2(1, 0)));
    float size = length(n);
    if (size > 0.0) {
      n *= (dot(n, pointAt(pixel)) > 0.0 ? -1.0 : 1.0) / size;
      color = 0.5 + 0.5 * n * vec3(1.0, -1.0, -1.0);
    }
  } else if (z > 0.0) {
    float t = range.y > range.x ? clamp((1.0 / z - range.x) / (range.y - range.x), 0.0, 1.0) : 1.0;
    color = texture2D(ramp, vec2((255.0 * (0.12 + 0.88 * t) + 0.5) / 256.0, 0.5)).rgb;
  }
  gl_FragColor = vec4(color, 1.0);
}`;

const sampleShader = `
precision highp float;
precision highp sampler2D;
${depthShader}
varying vec2 place;
void main() { gl_FragColor = vec4(depthAt(ivec2(place * vec2(textureSize(gathered, 0)))), 0.0, 0.0, 1.0); }`;

const quad = material => {
  const mesh = new Mesh(new PlaneGeometry(2, 2), material);
  mesh.frustumCulled = false;
  return new Scene().add(mesh);
};
const material = (fragmentShader, uniforms) =>
  new ShaderMaterial({
    vertexShader: compositeVertexShader,
    fragmentShader,
    uniforms,
    depthTest: false,
    depthWrite: false,
  });

export class Surface {
  constructor(renderer) {
    this.renderer = renderer;
    this.eye = new OrthographicCamera();
  }

  // Where depths are summed. Made when it is first asked for: most people never do.
  get gathered() {
    if (!this.target) this.make();
    return this.target;
  }

  make() {
    const {extensions} = this.renderer,
      isFloat = extensions.has('EXT_color_buffer_float') && extensions.has('EXT_float_blend');
    const target = (side, type) =>
      new WebGLRenderTarget(side, side, {
        type,
        minFilter: NearestFilter,
        magFilter: NearestFilter,
        depthBuffer: false,
      });
    this.target = target(1, isFloat ? FloatType : HalfFloatType);
    this.sample = target(SAMPLE, FloatType);
    const ramp = new DataTexture(rampBytes(), 256, 1, RGBAFormat);
    ramp.minFilter = ramp.magFilter = LinearFilter;
    ramp.needsUpdate = true;
    const gathered = {value: this.target.texture};
    this.uniforms = {
      gathered,
      ramp: {value: ramp},
      showsNormals: {value: false},
      range: {value: new Vector2()},
      lens: {value: new Vector4()},
    };
    this.picture = quad(material(fragmentShader, this.uniforms));
    this.sampler = quad(material(sampleShader, {gathered}));
  }

  // gather(size): sums the depths of all splats into this.gathered
  draw(gather, {quantity, width, height, lens, to}) {
    gather({width, height});
    const x = width / lens.width,
      y = height / lens.height;
    this.uniforms.lens.value.set(lens.fx * x, lens.fy * y, lens.cx * x, lens.cy * y);
    this.uniforms.showsNormals.value = quantity === 'normal';
    if (quantity === 'depth') this.measureRange();
    this.renderer.setRenderTarget(to);
    this.renderer.render(this.picture, this.eye);
  }

  // The range of the ramp: the depths without the nearest and farthest hundredth.
  measureRange() {
    const depths = new Float32Array(4 * SAMPLE * SAMPLE);
    this.renderer.setRenderTarget(this.sample);
    this.renderer.render(this.sampler, this.eye);
    this.read(this.sample, 0, 0, SAMPLE, SAMPLE, depths);
    const seen = depths.filter((depth, i) => i % 4 === 0 && depth > 0).sort();
    if (!seen.length) return;
    const skip = Math.floor(OUTLIERS * seen.length);
    this.uniforms.range.value.set(1 / seen[seen.length - 1 - skip], 1 / seen[skip]);
  }

  // After gather(): the depth at a pixel, y down, or null where little is.
  depthAt(x, y) {
    const sum = this.gathered.texture.type === FloatType ? new Float32Array(4) : new Uint16Array(4);
    this.read(this.gathered, Math.floor(x), this.gathered.height - 1 - Math.floor(y), 1, 1, sum);
    const [depth, , , alpha] = sum instanceof Uint16Array ? [...sum].map(fromHalf) : sum;
    return alpha >= SEEN ? depth / alpha : null;
  }

  // Spark may have bound a buffer for its own reading.
  read(target, x, y, width, height, to) {
    const gl = this.renderer.getContext(),
      bound = gl.getParameter(gl.PIXEL_PACK_BUFFER_BINDING);
    gl.bindBuffer(gl.PIXEL_PACK_BUFFER, null);
    this.renderer.readRenderTargetPixels(target, x, y, width, height, to);
    gl.bindBuffer(gl.PIXEL_PACK_BUFFER, bound);
  }
}

function fromHalf(bits) {
  const exponent = (bits >> 10) & 31,
    fraction = bits & 1023,
    sign = bits >> 15 ? -1 : 1;
  return sign * (exponent ? 2 ** (exponent - 15) * (1 + fraction / 1024) : fraction * 2 ** -24);
}
