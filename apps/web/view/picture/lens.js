// SPDX-License-Identifier: Apache-2.0
// Lenses: the intrinsics of a picture, and those of a window that shows it. A lens is {width,
// height, fx, fy, cx, cy} in pixels, (0, 0) the outer corner of the first pixel (COLMAP).
import {Matrix4, Quaternion, Vector3} from 'three';

export const lensOf = ({width, height, fx, fy, cx, cy}) => ({width, height, fx, fy, cx, cy});

// The centered lens with a field of view of `degrees` along the shorter side of the picture.
export function plainLens(width, height, degrees) {
  const focal = Math.min(width, height) / 2 / Math.tan((degrees * Math.PI) / 360);
  return {width, height, fx: focal, fy: focal, cx: width / 2, cy: height / 2};
}

/// The lens of a window of width x height that shows the whole picture of `lens`, as large as it
/// fits between the margins `above` and `below`. Its `picture` is the place of the picture in the
/// window: {left, top, width, height}.
export function fitted(lens, width, height, {above = 0, below = 0} = {}) {
  const scale = Math.min(width / lens.width, (height - above - below) / lens.height);
  const picture = {width: lens.width * scale, height: lens.height * scale};
  picture.left = (width - picture.width) / 2;
  picture.top = above + (height - above - below - picture.height) / 2;
  return {
    width,
    height,
    fx: lens.fx * scale,
    fy: lens.fy * scale,
    cx: lens.cx * scale + picture.left,
    cy: lens.cy * scale + picture.top,
    picture,
  };
}

/// The lens of the same picture at another number of pixels.
export function resized(lens, width, height) {
  const x = width / lens.width,
    y = height / lens.height;
  return {width, height, fx: lens.fx * x, fy: lens.fy * y, cx: lens.cx * x, cy: lens.cy * y};
}

/// The projection matrix of this lens for WebGL (x right, y up, looking along -z, clip space
/// -1..1).
export function projectionOf({width, height, fx, fy, cx, cy}, near, far) {
  return new Matrix4().set(
    (2 * fx) / width,
    0,
    1 - (2 * cx) / width,
    0,
    0,
    (2 * fy) / height,
    (2 * cy) / height - 1,
    0,
    0,
    0,
    -(far + near) / (far - near),
    (-2 * far * near) / (far - near),
    0,
    0,
    -1,
    0,
  );
}

const mix = (a, b, t) => a + (b - a) * t;
export function mixedLens(a, b, t) {
  // To the same width, so that the numbers can be mixed.
  const from = resized(a, b.width, (b.width * a.height) / a.width);
  return Object.fromEntries(Object.keys(b).map(key => [key, mix(from[key], b[key], t)]));
}

// Half a turn about x: from camera axes of COLMAP (x right, y down, z forward) to those of WebGL.
const flip = new Matrix4().makeScale(1, -1, -1);

/// The pose {position, quaternion} in WebGL's camera axes of a world_from_camera given by rows.
export function poseFromRows(rows) {
  const matrix = new Matrix4().set(...rows).multiply(flip),
    pose = {position: new Vector3(), quaternion: new Quaternion()};
  matrix.decompose(pose.position, pose.quaternion, new Vector3());
  return pose;
}

/// The inverse: world_from_camera as 16 numbers by rows.
export function rowsOfPose({position, quaternion}) {
  const matrix = new Matrix4().compose(position, quaternion, new Vector3(1, 1, 1)).multiply(flip);
  return matrix.transpose().toArray();
}

/// A camera as cameras.json lists it.
export function cameraEntry(id, name, pose, {width, height, fx, fy, cx, cy}) {
  const m = rowsOfPose(pose);
  return {
    id,
    img_name: name,
    width: Math.round(width),
    height: Math.round(height),
    position: [m[3], m[7], m[11]],
    rotation: [m.slice(0, 3), m.slice(4, 7), m.slice(8, 11)],
    fy,
    fx,
    cx,
    cy,
  };
}
