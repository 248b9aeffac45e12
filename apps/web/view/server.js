// SPDX-License-Identifier: Apache-2.0
// The page's requests to its server (docs/reference/viewer_http.md). Every failure becomes an Error
// whose message is a sentence.

const OVERTAKEN = 409; // the status of a frame that a newer request of this page has replaced

async function ask(address, options = {}) {
  let response;
  try {
    response = await fetch(address, {cache: 'no-store', ...options});
  } catch {
    throw new Error('The server does not answer. Is gemsplat still running?');
  }
  if (response.ok || response.status === OVERTAKEN) return response;
  const words = (await response.text().catch(() => '')).trim();
  throw new Error(
    words && words.length < 600 && !words.startsWith('<')
      ? words
      : `The server answered ${address} with ${response.status}.`,
  );
}

async function json(address) {
  const response = await ask(address);
  try {
    return await response.json();
  } catch {
    throw new Error(`The server's answer to ${address} cannot be read.`);
  }
}

export const askForScene = () => json('scene.json');
/// The state of a run, with the losses that were logged after a step.
export const askForState = afterStep => json(`state.json?after=${afterStep}`);

/// Asks a run to pause, resume, save or stop.
export const askToControl = (what, token) =>
  ask(`control?do=${what}`, {method: 'POST', headers: {'X-Control-Token': token}});

/// The model's bytes as they arrive: {stream, length}. progress(share) is called as they come, with
/// 0 to 1.
export async function askForModel(version, bytes, progress) {
  const response = await ask(`model?v=${version}`);
  const length = Number(response.headers.get('Content-Length')) || bytes || 0;
  let seen = 0;
  const counted = new TransformStream({
    transform(chunk, controller) {
      seen += chunk.byteLength;
      if (length) progress(Math.min(1, seen / length));
      controller.enqueue(chunk);
    },
  });
  return {stream: response.body.pipeThrough(counted), length: length || undefined};
}

/// The bytes of the model's mesh, a .glb.
export const askForMesh = async () => (await ask('mesh')).arrayBuffer();

/// Where a model lies whose parts are fetched one by one.
export const modelAddress = version => new URL(`model?v=${version}`, location.href).href;

/// A camera's photo as an ImageBitmap.
export const askForPhoto = async address => createImageBitmap(await (await ask(address)).blob());

/// A frame as {picture: ImageBitmap, milliseconds}: milliseconds that the server rendered, or null
/// if it did not say. The frame is null if a newer request has replaced this one.
export async function askForFrame(query) {
  const response = await ask(`frame?${new URLSearchParams(query)}`);
  if (response.status === OVERTAKEN) return null;
  const header = response.headers.get('X-Render-Ms');
  const picture = await createImageBitmap(await response.blob());
  return {picture, milliseconds: header === null ? null : Number(header)};
}
