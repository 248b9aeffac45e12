// SPDX-License-Identifier: Apache-2.0
// Serves folders of this machine to a page, whole files and ranges of them.
import {createServer} from 'node:http';
import {readFile} from 'node:fs/promises';
import {extname, join, normalize} from 'node:path';

const TYPES = {
  '.html': 'text/html; charset=utf-8', '.js': 'text/javascript', '.mjs': 'text/javascript',
  '.json': 'application/json', '.webp': 'image/webp', '.wasm': 'application/wasm'};

export class RangeServer {
  // roots: {name: folder}: /name/FILE is FILE of the folder; pages: {name: text}: HTML.
  static async start({roots, pages}) {
    const server = new RangeServer();
    Object.assign(server, {roots, pages});
    server.http = createServer((request, response) => server.answer(request, response).catch(() => response.writeHead(404).end()));
    await new Promise(done => server.http.listen(0, '127.0.0.1', done));
    server.url = `http://127.0.0.1:${server.http.address().port}/`;
    return server;
  }

  async answer(request, response) {
    const path = decodeURIComponent(new URL(request.url, this.url).pathname), [, root, ...rest] = path.split('/');
    if (path.slice(1) in this.pages) return response.writeHead(200, {'Content-Type': TYPES['.html']}).end(this.pages[path.slice(1)]);
    if (!this.roots[root]) return response.writeHead(path === '/favicon.ico' ? 204 : 404).end();
    const name = normalize(rest.join('/')), all = await readFile(join(this.roots[root], name));
    const [, from, to] = request.headers.range?.match(/^bytes=(\d+)-(\d*)$/) ?? [];
    const begin = Number(from ?? 0), end = to ? Math.min(Number(to) + 1, all.length) : all.length;
    response.writeHead(from === undefined ? 200 : 206, {
      'Content-Type': TYPES[extname(name)] ?? 'application/octet-stream', 'Content-Length': end - begin, 'Accept-Ranges': 'bytes',
      ...(from === undefined ? {} : {'Content-Range': `bytes ${begin}-${end - 1}/${all.length}`})}).end(all.subarray(begin, end));
  }

  close() {
    this.http.closeAllConnections();
    return new Promise(done => this.http.close(done));
  }
}
