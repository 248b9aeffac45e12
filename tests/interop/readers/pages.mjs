// SPDX-License-Identifier: Apache-2.0
// Pages in which programs of others show one file: window.show(url) resolves when the picture stands.
// Each camera is at (0, 0, -5) or (0, 0, 5) of its program's world, looks at the origin with y up or
// down, and sees 60 degrees on a black background. The picture is SIZE pixels on each side.
export const SIZE = 300;

const HEAD = `const SIZE = ${SIZE};
const frames = n => new Promise(done => { const next = () => n-- > 0 ? requestAnimationFrame(next) : done(); next(); });
`;

const spark = `import {Color, PerspectiveCamera, Scene, WebGLRenderer} from 'three';
import {SparkRenderer, SplatMesh} from '@sparkjsdev/spark';
window.show = async url => {
  const renderer = new WebGLRenderer(), scene = new Scene(), camera = new PerspectiveCamera(60, 1, 0.1, 100);
  renderer.setSize(SIZE, SIZE);
  document.body.append(renderer.domElement);
  scene.background = new Color(0);
  camera.position.z = 5;
  scene.add(new SparkRenderer({renderer}));
  const mesh = new SplatMesh({url, lod: url.endsWith('.rad') || undefined});
  await mesh.initialized;
  scene.add(mesh);
  renderer.setAnimationLoop(() => renderer.render(scene, camera));
  await frames(60);
};`;

const playcanvas = `import * as pc from 'playcanvas';
window.show = url => new Promise((done, failed) => {
  const canvas = document.createElement('canvas');
  canvas.width = canvas.height = SIZE;
  document.body.append(canvas);
  const app = new pc.Application(canvas, {graphicsDeviceOptions: {antialias: false, alpha: false}});
  app.setCanvasFillMode(pc.FILLMODE_NONE);
  app.setCanvasResolution(pc.RESOLUTION_FIXED, SIZE, SIZE);
  app.start();
  const eye = new pc.Entity();
  eye.addComponent('camera', {
    clearColor: new pc.Color(0, 0, 0), fov: 60, nearClip: 0.1, farClip: 100});
  eye.setPosition(0, 0, 5);
  app.root.addChild(eye);
  const isGlb = url.endsWith('.glb');
  const asset = new pc.Asset('model', isGlb ? 'container' : 'gsplat', {url});
  app.assets.add(asset);
  asset.on('error', message => failed(new Error(message)));
  asset.ready(async () => {
    try {
      if (isGlb) {
        app.root.addChild(asset.resource.instantiateRenderEntity());
      } else {
        const model = new pc.Entity();
        model.addComponent('gsplat', {asset});
        app.root.addChild(model);
      }
      await frames(60);
      done();
    } catch (error) { failed(error); }
  });
  app.assets.load(asset);
});`;

const babylon = `import {Engine} from '@babylonjs/core/Engines/engine';
import {Scene} from '@babylonjs/core/scene';
import {FreeCamera} from '@babylonjs/core/Cameras/freeCamera';
import {Vector3} from '@babylonjs/core/Maths/math.vector';
import {Color4} from '@babylonjs/core/Maths/math.color';
import {ImportMeshAsync} from '@babylonjs/core/Loading/sceneLoader';
import '@babylonjs/core/Materials/standardMaterial';
import '@babylonjs/loaders/SPLAT';
import '@babylonjs/loaders/glTF';
import * as fflate from 'fflate';
window.fflate = fflate;  // the loader would fetch it, and the library for .spz, from the network
window.show = async url => {
  const canvas = document.createElement('canvas');
  canvas.width = canvas.height = SIZE;
  document.body.append(canvas);
  const engine = new Engine(canvas, false), scene = new Scene(engine);
  scene.clearColor = new Color4(0, 0, 0, 1);
  const camera = new FreeCamera('eye', new Vector3(0, 0, -5), scene);
  camera.fov = Math.PI / 3;
  camera.minZ = 0.1;
  camera.setTarget(Vector3.Zero());
  const spzLibraryUrl = location.origin + '/adobe-spz/spz.js';
  await ImportMeshAsync(url, scene, {pluginOptions: {splat: {fflate, spzLibraryUrl}}});
  engine.runRenderLoop(() => scene.render());
  await scene.whenReadyAsync();
  await frames(60);
};`;

const gaussianSplats3d = `import * as GaussianSplats3D from '@mkkellogg/gaussian-splats-3d';
window.show = async url => {
  const root = document.createElement('div');
  root.style = 'width: ' + SIZE + 'px; height: ' + SIZE + 'px';
  document.body.append(root);
  const viewer = new GaussianSplats3D.Viewer({
    rootElement: root, cameraUp: [0, 1, 0], initialCameraPosition: [0, 0, 5],
    initialCameraLookAt: [0, 0, 0], sharedMemoryForWorkers: false, gpuAcceleratedSort: false,
    sphericalHarmonicsDegree: 2, useBuiltInControls: false,
    sceneRevealMode: GaussianSplats3D.SceneRevealMode.Instant});
  await viewer.addSplatScene(
      url, {showLoadingUI: false, splatAlphaRemovalThreshold: 1, progressiveLoad: false});
  viewer.camera.fov = 60;
  viewer.camera.updateProjectionMatrix();
  viewer.start();
  await frames(90);
};`;

/// Program -> its package, and the script of its page.
export const PAGES = {
  Spark: {name: '@sparkjsdev/spark', script: HEAD + spark},
  PlayCanvas: {name: 'playcanvas', script: HEAD + playcanvas},
  'Babylon.js': {name: '@babylonjs/loaders', script: HEAD + babylon},
  GaussianSplats3D: {name: '@mkkellogg/gaussian-splats-3d', script: HEAD + gaussianSplats3d},
};

/// CesiumJS, as its own file serves it. A tileset is shown from the same place, a .glb as a model.
export const CESIUM_PAGE = `<!doctype html><meta charset="utf-8"><link rel="icon" href="data:,">
<style>html, body { margin: 0; background: #000 } #map, .cesium-widget, canvas { width: ${SIZE}px; height: ${SIZE}px }</style>
<div id="map"></div><script>window.CESIUM_BASE_URL = '/cesium/'</script><script src="/cesium/Cesium.js"></script>
<script>
const frames = n => new Promise(done => { const next = () => n-- > 0 ? requestAnimationFrame(next) : done(); next(); });
window.show = async (url, place) => {
  Cesium.Ion.defaultAccessToken = '';
  const widget = new Cesium.CesiumWidget('map', {
    globe: false, baseLayer: false, skyBox: false, skyAtmosphere: false, msaaSamples: 1,
    showRenderLoopErrors: false, creditContainer: document.createElement('div'),
    contextOptions: {webgl: {alpha: false}}});
  const {scene} = widget, failures = [];
  for (const part of ['sun', 'moon']) if (scene[part]) scene[part].show = false;
  scene.backgroundColor = Cesium.Color.BLACK;
  scene.highDynamicRange = false;
  scene.renderError.addEventListener((_, error) => failures.push(String(error)));
  const toEarth = Cesium.Transforms.eastNorthUpToFixedFrame(Cesium.Cartesian3.fromDegrees(...place));
  const at = v => Cesium.Matrix4.multiplyByPoint(toEarth, new Cesium.Cartesian3(...v), new Cesium.Cartesian3());
  const along = v => Cesium.Matrix4.multiplyByPointAsVector(toEarth, new Cesium.Cartesian3(...v), new Cesium.Cartesian3());
  scene.camera.frustum = new Cesium.PerspectiveFrustum({
    fov: Math.PI / 3, aspectRatio: 1, near: 0.1, far: 1e5});
  scene.camera.setView({
    destination: at([0, -5, 0]),
    orientation: {direction: along([0, 1, 0]), up: along([0, 0, 1])}});
  let tileset = null;
  if (url.endsWith('.json')) {
    tileset = await Cesium.Cesium3DTileset.fromUrl(url);
    tileset.tileFailed.addEventListener(({message}) => failures.push(message));
    scene.primitives.add(tileset);
  } else {
    const model = await Cesium.Model.fromGltfAsync({url, modelMatrix: toEarth});
    scene.primitives.add(model);
  }
  await frames(200);
  if (failures.length) throw new Error(failures[0]);
};
</script>`;
