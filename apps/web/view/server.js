// SPDX-License-Identifier: Apache-2.0
// What the page asks its server for. Every failure becomes a sentence.

const OVERTAKEN = 409;  // the status of a frame that nobody waits for any more

async function ask(address) {
  let response;
  try {
    response = await fetch(address, {cache: 'no-store'});
  } catch {
    throw new Error('The server does not answer. Does gemsplat still run?');
  }
  if (response.ok || response.status === OVERTAKEN) return response;
  const words = (await response.text().catch(() => '')).trim();
  throw new Error(words && words.length < 600 && !words.startsWith('<') ? words : `The server answered ${address} with ${response.status}.`);
}

async function json(address) {
  const response = await ask(address);
  try {
    return await response.json();
  } catch {
    throw new Error(`What the server sent as ${address} cannot be read.`);
  }
}

export const askForScene = () => json('scene.json');
export const askForState = () => json('state.json');

/// The model's bytes as they arrive: {stream, length}; `progress(share)` is told how much of them is there, 0 to 1.
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

/// A frame as {picture: ImageBitmap, milliseconds}: what it took the server, or null where it did not say. Null where a
/// newer question has overtaken this one.
export async function askForFrame(query) {
  const response = await ask(`frame?${new URLSearchParams(query)}`);
  if (response.status === OVERTAKEN) return null;
  const header = response.headers.get('X-Render-Ms');
  const picture = await createImageBitmap(await response.blob());
  return {picture, milliseconds: header === null ? null : Number(header)};
}
