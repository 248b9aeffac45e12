// SPDX-License-Identifier: Apache-2.0
// The picture that the browser draws: Spark on three.js, set up to agree with gemsplat's renderer
// (docs/reference/viewer.md).
import {PagedSplats, SparkRenderer, SplatFileType, SplatMesh} from '@sparkjsdev/spark';
import {readGs4d} from './gs4d.js';
import {MovingModel} from './moving.js';
import {
  Color,
  HalfFloatType,
  LinearFilter,
  Matrix4,
  Mesh,
  PerspectiveCamera,
  PlaneGeometry,
  Raycaster,
  Scene,
  ShaderMaterial,
  UnsignedByteType,
  Vector2,
  Vector3,
  WebGLRenderTarget,
} from 'three';
import {lookUniforms, setLook} from './look.js';
import {
  compositeFragmentShader,
  compositeVertexShader,
  effectUniforms,
  fragmentShader,
  vertexShader,
} from './shaders.js';
import {Surface} from './surface.js';

// Pixels^2: kBlur and kBlurAntialias of gs_core/math/constants.h.
const BLUR = 0.3,
  BLUR_ANTIALIASED = 0.1;
const MIN_ALPHA = 1 / 255; // kMinAlpha
// Picture sizes: no splat is culled because its center lies outside the picture.
const FAR_OUTSIDE = 1e4;
const ANY_SIZE = 1e6; // pixels: no splat is made smaller
// Of GPU memory at full precision: the mesh and Spark's working copies.
const BYTES_PER_GAUSSIAN = 200;
const STREAM_TICK = 50; // milliseconds between looks at what has arrived of a streamed model
const PAGE = 65536; // Gaussians of a chunk of .rad
// Larger models get 16-byte Gaussians.
const MOST_BYTES = /Android|iPhone|iPad/.test(navigator.userAgent) ? 2 ** 28 : 2 ** 30;

const FILE_TYPES = {
  ply: SplatFileType.PLY,
  'compressed.ply': SplatFileType.PLY,
  spz: SplatFileType.SPZ,
  sog: SplatFileType.PCSOGSZIP,
  splat: SplatFileType.SPLAT,
};

export class SplatPicture {
  // model: of scene.json, if it is known already; changed(): called when there is something new to
  // draw; arrived(): when all parts of a streamed model that the view needs are there.
  constructor(renderer, model, changed, arrived) {
    this.renderer = renderer;
    this.changed = changed;
    this.arrived = arrived;
    this.precise = (model?.gaussians ?? 0) * BYTES_PER_GAUSSIAN <= MOST_BYTES;
    this.mesh = null;
    this.streamed = null; // of a model whose parts are fetched as the view needs them
    this.time = 0; // of a model that moves
    this.timeOf = new WeakMap(); // of what Spark has gathered
    this.scene = new Scene();
    this.camera = new PerspectiveCamera();
    this.effects = effectUniforms();
    this.points = 0; // their size in CSS pixels; 0: splats are shown
    this.spark = new SparkRenderer({
      extraUniforms: this.effects,
      renderer,
      onDirty: changed,
      fragmentShader,
      enableLod: false,
      sortRadial: false,
      accumExtSplats: this.precise,
      minAlpha: MIN_ALPHA,
      maxStdDev: Math.sqrt(2 * Math.log(1 / MIN_ALPHA)),
      clipXY: FAR_OUTSIDE,
      maxPixelRadius: ANY_SIZE,
      depthTest: false,
    });
    this.spark.material.vertexShader = vertexShader(this.spark.material.vertexShader);
    this.scene.add(this.spark);
    this.setAntialiased(model?.antialiased ?? false);
    this.gathered = gatheringTarget(renderer);
    this.composite = new Mesh(
      new PlaneGeometry(2, 2),
      new ShaderMaterial({
        vertexShader: compositeVertexShader,
        fragmentShader: compositeFragmentShader,
        depthTest: false,
        depthWrite: false,
        uniforms: {
          gathered: {value: this.gathered.texture},
          background: {value: new Vector3()},
          ...lookUniforms(),
        },
      }),
    );
    this.composite.frustumCulled = false;
    this.last = new Scene().add(this.composite);
    this.background = new Color(0);
    this.surface = new Surface(renderer);
    this.quantity = 'color';
  }

  setEffect(name, value) {
    this.effects[name].value = value;
    this.changed();
  }
  setPoints(size) {
    this.points = size;
    this.changed();
  }
  setQuantity(quantity) {
    this.quantity = quantity;
    this.changed();
  }

  setAntialiased(antialiased) {
    this.spark.preBlurAmount = antialiased ? 0 : BLUR; // blur without compensation of the opacity
    this.spark.blurAmount = antialiased ? BLUR_ANTIALIASED : 0;
  }

  setBackground(color) {
    this.composite.material.uniforms.background.value.set(...color);
    this.background.setRGB(...color);
    this.changed();
  }

  setShDegree(degree) {
    this.shDegree = degree;
    if (!this.mesh) return;
    this.mesh.maxSh = degree;
    this.mesh.updateGenerator();
    this.changed();
  }

  // Reads a model completely, then replaces the shown one with it; a first model that moves is shown
  // while it arrives. read: {stream, length}; played({duration, loaded}): called as more of a model
  // that moves can be played
  async load(model, read, played) {
    if (model.format === 'gs4d') return this.loadMoving(read, played);
    if (model.format === 'rad') return this.stream(model, read.address);
    const fileType = FILE_TYPES[model.format];
    if (!fileType) throw new Error(`This page does not read .${model.format} files.`);
    const next = new SplatMesh({
      stream: read.stream,
      streamLength: read.length,
      fileType,
      extSplats: this.precise,
    });
    try {
      await next.initialized;
    } catch (error) {
      next.dispose();
      throw error;
    }
    this.prepare(next, model);
    this.replaceWith(next);
  }

  prepare(next, model) {
    if (model.world_from_file)
      new Matrix4()
        .set(...model.world_from_file)
        .decompose(next.position, next.quaternion, next.scale);
    if (this.shDegree !== undefined) next.maxSh = this.shDegree;
    this.setAntialiased(model.antialiased ?? false);
  }

  // Shows a tree of levels of detail, of which Spark fetches the chunks that the view needs, coarse
  // ones first. Returns when the coarsest ones are shown.
  async stream(model, address) {
    const {spark} = this,
      paged = new PagedSplats({rootUrl: address, fileType: SplatFileType.RAD});
    const {meta} = await paged.radMetaPromise;
    spark.enableLod = spark.enableDriveLod = true;
    spark.pagedExtSplats = this.precise;
    spark.maxPagedSplats = Math.min(spark.maxPagedSplats, meta.chunks.length * PAGE);
    const next = new SplatMesh({paged});
    this.prepare(next, model);
    this.replaceWith(next);
    this.streamed = {
      gaussians: model.gaussians,
      wasBusy: false,
      timer: setInterval(() => this.followStream(), STREAM_TICK),
    };
    while (!(paged.numSplats > 0)) await new Promise(done => setTimeout(done, STREAM_TICK));
  }

  // Spark looks for what has arrived when a frame is drawn.
  followStream() {
    const isBusy = this.isStreaming,
      {wasBusy} = this.streamed;
    this.streamed.wasBusy = isBusy;
    if (isBusy) this.changed();
    else if (wasBusy) this.arrived();
  }

  async loadMoving({stream}, played) {
    const {header, chunks} = await readGs4d(stream),
      {duration, table} = header;
    const next = new MovingModel(),
      isFirst = this.mesh === null;
    if (this.shDegree !== undefined) next.maxSh = this.shDegree;
    const show = () => {
      next.time = this.time;
      this.setAntialiased(header.antialiased);
      this.replaceWith(next);
    };
    try {
      let arrived = 0;
      for await (const chunk of chunks) {
        next.add(chunk);
        const loaded = Math.min(Infinity, ...table.slice(++arrived).map(({begin}) => begin));
        if (!isFirst) continue;
        if (this.mesh !== next && loaded > this.time) show();
        if (this.mesh === next) played({duration, loaded: Math.min(1, loaded)});
        this.changed();
        await new Promise(done => setTimeout(done)); // the page stays alive
      }
    } catch (error) {
      if (this.mesh !== next) next.dispose();
      throw error;
    }
    if (this.mesh !== next) show();
    played({duration, loaded: 1});
  }

  replaceWith(next) {
    this.scene.add(next);
    clearInterval(this.streamed?.timer);
    this.streamed = null;
    if (this.mesh) {
      this.scene.remove(this.mesh);
      this.mesh.dispose(); // Spark shows its copy of it until the next model is sorted
    }
    this.mesh = next;
    this.changed();
  }

  get gaussians() {
    return this.streamed?.gaussians ?? this.mesh?.numSplats ?? 0;
  }
  // Whether no Gaussian is drawn, though the model has some.
  get isBlank() {
    return this.gaussians > 0 && this.spark.activeSplats === 0;
  }
  get isPending() {
    return (
      this.spark.sorting ||
      this.spark.sortDirty ||
      this.spark.dirty ||
      this.isStreaming ||
      !this.showsItsTime
    );
  }
  // Whether chunks that this view needs are on their way, or not yet drawn.
  get isStreaming() {
    if (!this.streamed) return false;
    const {pager, lodDirty, lodUpdates, lodWorker} = this.spark;
    return (
      !pager ||
      lodDirty ||
      lodUpdates.length > 0 ||
      lodWorker.queue !== null ||
      pager.fetchers.length > 0 ||
      pager.fetched.length > 0 ||
      pager.lodTreeUpdates.length > 0 ||
      pager.newUploads.length > 0 ||
      pager.readyUploads.length > 0
    );
  }

  setTime(time) {
    if (time === this.time) return;
    this.time = time;
    if (this.mesh instanceof MovingModel) this.mesh.time = time;
    this.changed();
  }
  // The picture is that of the time, and sorted for it.
  get showsItsTime() {
    return !(this.mesh instanceof MovingModel) || this.timeOf.get(this.spark.display) === this.time;
  }
  // Remembers the time of what Spark has gathered last.
  noteTime() {
    if (this.spark.current === this.noted) return;
    this.noted = this.spark.current;
    this.timeOf.set(this.noted, this.time);
  }

  // pose: {position, quaternion}; projection: Matrix4
  place({position, quaternion}, projection) {
    this.camera.position.copy(position);
    this.camera.quaternion.copy(quaternion);
    this.camera.updateMatrixWorld(true);
    this.camera.projectionMatrix.copy(projection);
    this.camera.projectionMatrixInverse.copy(projection).invert();
    this.camera.fov = (2 * Math.atan(1 / projection.elements[5]) * 180) / Math.PI; // decides on levels of detail
  }

  // lens: of the window, in CSS pixels; to: the target, or null for the canvas
  draw(width, height, lens, to = null) {
    this.effects.worldFromView.value.copy(this.camera.matrixWorld);
    this.effects.pointRadius.value = ((this.points / 2) * width) / lens.width;
    if (this.quantity !== 'color')
      return this.surface.draw(size => this.gatherDepths(size), {
        quantity: this.quantity,
        width,
        height,
        lens,
        to,
      });
    this.gather(this.gathered, width, height);
    this.renderer.setRenderTarget(to);
    this.renderer.render(this.last, this.camera);
  }

  gather(target, width, height) {
    if (target.width !== width || target.height !== height) target.setSize(width, height);
    this.renderer.setRenderTarget(target);
    this.renderer.setClearColor(0, 0);
    this.renderer.clear();
    this.renderer.render(this.scene, this.camera);
    this.noteTime();
  }

  gatherDepths({width, height}) {
    this.effects.showsDepth.value = true;
    this.gather(this.surface.gathered, width, height);
    this.effects.showsDepth.value = false;
  }

  // The depth at a place of the window (CSS pixels) along the viewing axis, or null where nothing is.
  depthAt(x, y, {width, height}) {
    this.effects.worldFromView.value.copy(this.camera.matrixWorld);
    this.gatherDepths({width, height});
    const depth = this.surface.depthAt(x, y);
    this.changed();
    return depth;
  }

  // look: of a photo (look.js), or null for the scene's own colors
  setLook(look) {
    setLook(this.composite.material.uniforms, look);
    this.changed();
  }

  // Sorts for exactly this view: while the view moves, Spark sorts for one some milliseconds ago.
  async settle() {
    if (!this.mesh) return;
    const update = this.spark.update({scene: this.scene, camera: this.camera});
    this.noteTime();
    await update;
    while (this.spark.sorting || this.spark.sortDirty)
      await new Promise(done => setTimeout(done, 4));
    this.changed();
  }

  // The world point of the nearest Gaussian at a place of the picture (-1..1, y up), or null.
  pick(x, y) {
    if (!this.mesh) return null;
    const ray = new Raycaster();
    ray.setFromCamera(new Vector2(x, y), this.camera);
    const hits = [];
    this.mesh.raycast(ray, hits);
    if (!hits.length) return null;
    return hits.reduce((a, b) => (b.distance < a.distance ? b : a)).point.clone();
  }
}

// The target in which splats are summed. Half precision, because eight bits would round each of
// hundreds of faint splats.
function gatheringTarget(renderer) {
  const half =
    renderer.extensions.has('EXT_color_buffer_float') ||
    renderer.extensions.has('EXT_color_buffer_half_float');
  return new WebGLRenderTarget(1, 1, {
    type: half ? HalfFloatType : UnsignedByteType,
    minFilter: LinearFilter,
    magFilter: LinearFilter,
    depthBuffer: false,
  });
}
