// SPDX-License-Identifier: Apache-2.0
// A page that shows a streamed SOG in PlayCanvas from a camera of cameras.json, without changes of
// the engine's own: window.show({url, camera, budget}) and window.settled().
export const playcanvasPage = `<!doctype html>
<style>html, body { margin: 0; background: black; overflow: hidden; } canvas { display: block; }</style>
<canvas></canvas>
<script type="module">
import * as pc from '/playcanvas/build/playcanvas.mjs';

const canvas = document.querySelector('canvas');
const app = new pc.Application(canvas, {graphicsDeviceOptions: {antialias: false, alpha: false}});
app.setCanvasFillMode(pc.FILLMODE_NONE);
app.setCanvasResolution(pc.RESOLUTION_AUTO);
app.start();

// Matrices of the files: x right, y down, z forward. Cameras of the engine look along -z, y up.
function place(entity, {position: p, rotation: r}) {
  const column = i => [r[0][i], r[1][i], r[2][i]];
  const [x, y, z] = [column(0), column(1).map(v => -v), column(2).map(v => -v)];
  const matrix = new pc.Mat4();
  matrix.set([...x, 0, ...y, 0, ...z, 0, ...p, 1]);
  entity.setPosition(...p);
  entity.setRotation(new pc.Quat().setFromMat4(matrix));
}

let quiet = 0;  // frames in a row in which nothing was loading or out of date
app.systems.gsplat.on('frame:ready', (camera, layer, ready, loading) => { quiet = ready && loading === 0 ? quiet + 1 : 0; });
window.settled = () => quiet > 5;

window.show = ({url, camera, budget}) => {
  const {width, height, fy} = camera;
  canvas.width = width; canvas.height = height;
  canvas.style.width = width + 'px'; canvas.style.height = height + 'px';
  app.resizeCanvas(width, height);
  const settings = app.scene.gsplat;
  settings.splatBudget = budget;
  settings.lodUnderfillLimit = 10;   // a coarser level until the wished one is there
  settings.minPixelSize = 0;         // far splats are drawn, too
  settings.minContribution = 0;
  const eye = new pc.Entity();
  eye.addComponent('camera', {
    clearColor: new pc.Color(0, 0, 0), fov: 2 * Math.atan(height / 2 / fy) * 180 / Math.PI,
    nearClip: 0.1, farClip: 1000});
  place(eye, camera);
  app.root.addChild(eye);
  const asset = new pc.Asset('scene', 'gsplat', {url});
  app.assets.add(asset);
  asset.ready(() => {
    const model = new pc.Entity();
    model.addComponent('gsplat', {asset});
    app.root.addChild(model);
    window.shown = true;
  });
  asset.on('error', message => console.error(message));
  app.assets.load(asset);
};
window.pageReady = true;
</script>`;
