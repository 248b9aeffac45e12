// SPDX-License-Identifier: Apache-2.0
// A small server with the viewer's API (docs/reference/viewer_http.md) for tests, and scenes for it
// to serve.
import {createServer} from 'node:http';
import {readFile, stat} from 'node:fs/promises';
import {basename, join} from 'node:path';

/// what: {page, scene, model(version), photo(index), state(afterStep), frame(query)}. model and
/// photo return a Buffer, state an object, mesh a Buffer, frame {body, milliseconds}; control(what, token) answers POST /control; each may throw {status,
/// message}, and may be replaced while the server runs.
export class ViewServer {
  static async start(what) {
    const server = new ViewServer(what);
    await new Promise(done => server.http.listen(0, '127.0.0.1', done));
    server.url = `http://127.0.0.1:${server.http.address().port}/`;
    return server;
  }

  constructor(what) {
    this.what = what;
    this.asked = []; // paths with queries, in order
    this.http = createServer((request, response) =>
      this.answer(request, response).catch(error => {
        response
          .writeHead(error.status ?? 500, {'Content-Type': 'text/plain; charset=utf-8'})
          .end(error.message);
      }),
    );
  }

  async answer(request, response) {
    const url = new URL(request.url, this.url),
      {what} = this;
    this.asked.push(url.pathname + url.search);
    const send = (type, body, headers = {}) =>
      response
        .writeHead(200, {
          'Content-Type': type,
          'Content-Length': Buffer.byteLength(body),
          ...headers,
        })
        .end(body);
    const json = value => send('application/json', JSON.stringify(value));
    const photo = url.pathname.match(/^\/photo\/(\d+)$/);
    if (url.pathname === '/control' && request.method === 'POST' && what.control)
      return json(
        what.control(url.searchParams.get('do'), request.headers['x-control-token']) ?? {},
      );
    if (url.pathname === '/') return send('text/html; charset=utf-8', await readFile(what.page));
    if (url.pathname === '/scene.json') return json(what.scene);
    if (url.pathname === '/state.json' && what.state)
      return json(await what.state(Number(url.searchParams.get('after'))));
    if (url.pathname === '/model')
      return send('application/octet-stream', await what.model(Number(url.searchParams.get('v'))));
    if (url.pathname === '/mesh' && what.mesh) return send('model/gltf-binary', what.mesh());
    if (photo && what.photo) return send('image/jpeg', await what.photo(Number(photo[1])));
    if (url.pathname === '/frame' && what.frame) {
      const {body, milliseconds} = await what.frame(url.searchParams);
      return send('image/jpeg', body, {'X-Render-Ms': String(milliseconds)});
    }
    throw Object.assign(new Error('There is no such page.'), {status: 404});
  }

  close() {
    this.http.closeAllConnections();
    return new Promise(done => this.http.close(done));
  }
}

const HALF_TURN = [1, 0, 0, 0, 0, -1, 0, 0, 0, 0, -1, 0, 0, 0, 0, 1]; // about x: .spz has y up
const FORMATS = ['compressed.ply', 'ply', 'spz', 'sog', 'splat'];
export const formatOf = file => FORMATS.find(ending => file.endsWith(`.${ending}`));

/// scene.json of a model's file, seen from the cameras of a run's cameras.json; `photos` says which
/// of them have one.
export async function sceneOf(
  run,
  file,
  {photos = () => null, gaussians, shDegree = 3, antialiased = false} = {},
) {
  const read = async name => JSON.parse(await readFile(join(run, name), 'utf8'));
  const split = await read('split.json').catch(() => ({train: [], test: []}));
  const tests = new Set(split.test.map(name => name.replace(/\.[^.]*$/, '')));
  const cameras = (await read('cameras.json')).map(
    ({img_name: name, width, height, fx, fy, cx, cy, rotation: r, position: p}, index) => ({
      name,
      split: tests.has(name) ? 'test' : 'train',
      width,
      height,
      fx,
      fy,
      cx,
      cy,
      world_from_camera: [...r[0], p[0], ...r[1], p[1], ...r[2], p[2], 0, 0, 0, 1],
      photo: photos(name) ? `photo/${index}` : null,
    }),
  );
  const column = (m, i) => [m[i], m[4 + i], m[8 + i]];
  const mean = vectors =>
    [0, 1, 2].map(i => vectors.reduce((sum, v) => sum + v[i], 0) / vectors.length);
  const centers = cameras.map(camera => column(camera.world_from_camera, 3)),
    middle = mean(centers);
  const radius = 1.1 * Math.max(...centers.map(c => Math.hypot(...c.map((x, i) => x - middle[i])))),
    ahead = mean(cameras.map(camera => column(camera.world_from_camera, 2)));
  return {
    title: basename(run),
    mode: 'file',
    background: [0, 0, 0],
    near: 0.2,
    far: 1e4,
    cameras,
    radius,
    up: mean(cameras.map(camera => column(camera.world_from_camera, 1))).map(x => -x),
    center: middle.map((x, i) => x + radius * ahead[i]),
    model: {
      format: formatOf(file),
      world_from_file: file.endsWith('.spz') ? HALF_TURN : undefined,
      gaussians,
      bytes: (await stat(file)).size,
      sh_degree: shDegree,
      antialiased,
      name: basename(file),
    },
  };
}
