// SPDX-License-Identifier: Apache-2.0
// Files and folders that people drop or choose, on their way to the studio in pieces. A file that was
// interrupted goes on where it ended when it is dropped again.
import {bytes} from '../shared/format.js';

const PIECE = 2 ** 21; // bytes
const AT_ONCE = 3;
const TRIES = 4;
const PAUSE = 700; // milliseconds, longer with each try

// The files below an entry of a drop, as [name, file].
async function filesBelow(entry, above = '') {
  const name = `${above}${entry.name}`;
  if (entry.name.startsWith('.')) return [];
  if (entry.isFile) {
    const file = await new Promise((done, failed) => entry.file(done, failed));
    return [[name, file]];
  }
  const reader = entry.createReader(),
    found = [];
  for (;;) {
    const some = await new Promise((done, failed) => reader.readEntries(done, failed));
    if (!some.length) return found;
    for (const each of some) found.push(...(await filesBelow(each, `${name}/`)));
  }
}

/// The files of a drop. A single folder gives its content, and its name to the project:
/// {name, files: [[name, file], ...]}.
export async function filesOfDrop(transfer) {
  const entries = [...transfer.items].map(item => item.webkitGetAsEntry?.()).filter(Boolean);
  const files = (await Promise.all(entries.map(entry => filesBelow(entry)))).flat();
  return withoutFolder(files);
}
export const filesOfInput = input =>
  withoutFolder([...input.files].map(file => [file.webkitRelativePath || file.name, file]));

function withoutFolder(files) {
  const top = files[0]?.[0].split('/')[0] ?? '';
  const isFolder = files.length > 0 && files.every(([name]) => name.startsWith(`${top}/`));
  if (isFolder)
    return {name: top, files: files.map(([name, file]) => [name.slice(top.length + 1), file])};
  return {name: top.replace(/\.[^.]*$/, ''), files};
}

async function withRetries(work) {
  for (let tries = 1; ; ++tries) {
    try {
      return await work();
    } catch (error) {
      if (!error.isGone || tries === TRIES) throw error;
      await new Promise(done => setTimeout(done, PAUSE * tries));
    }
  }
}

async function sendOne(server, name, file, sent) {
  let there = file.size > PIECE ? await server.uploaded(name, file.size) : {bytes: 0};
  sent(there.bytes);
  while (!there.is_whole) {
    const piece = file.slice(there.bytes, there.bytes + PIECE);
    const before = there.bytes;
    there = await withRetries(() => server.upload(name, before, file.size, piece));
    sent(there.bytes - before);
  }
}

/// Sends all of them. tell(text) says how far it is. Returns the sentences of those that failed.
export async function sendFiles(server, files, tell) {
  const all = files.reduce((sum, [, file]) => sum + file.size, 0),
    troubles = [],
    waiting = [...files];
  let done = 0,
    whole = 0,
    isOver = false;
  const show = () =>
    tell(
      `${whole} of ${files.length} files, ${bytes(done)} of ${bytes(all)}`,
      all ? done / all : 1,
    );
  const work = async () => {
    while (waiting.length && !isOver) {
      const [name, file] = waiting.shift();
      try {
        await sendOne(server, name, file, more => {
          done += more;
          show();
        });
        ++whole;
      } catch (error) {
        troubles.push(error.message);
        isOver = error.isGone || /disk is full|takes .* at most/.test(error.message);
      }
      show();
    }
  };
  show();
  await Promise.all(Array.from({length: AT_ONCE}, work));
  return [...new Set(troubles)];
}
