// SPDX-License-Identifier: Apache-2.0
// Mends Spark 2.2.0 while it is bundled. It packs three SH numbers into 8 bits each with a shared power of two, for which it
// rounds log2 of the largest down instead of up: whatever is above that power is cut off, up to half of its value.
// In its WebAssembly that rounding is "f32.floor, f32.const 15"; nothing else there is.
import {readFile} from 'node:fs/promises';

const DOWN = '8e4300007041', UP = '8d4300007041';  // f32.floor or f32.ceil, then f32.const 15
const PLACES = 30;                                 // it is inlined so often
const PROGRAM = /decode64\("([A-Za-z0-9+/=]+)"\)/g;

function mended(base64) {
  const parts = Buffer.from(base64, 'base64').toString('hex').split(DOWN);
  if (parts.length !== PLACES + 1) throw new Error(`Spark's program has changed: ${parts.length - 1} places to mend, ${PLACES} were expected (apps/web/spark_fix.mjs)`);
  return Buffer.from(parts.join(UP), 'hex').toString('base64');
}

export const sparkFix = {
  name: 'spark-fix',
  setup(build) {
    build.onLoad({filter: /@sparkjsdev\/spark\/dist\/spark\.module\.js$/}, async ({path}) => {
      const text = await readFile(path, 'utf8');
      if (text.match(PROGRAM)?.length !== 1) throw new Error(`Spark's program was not found in ${path} (apps/web/spark_fix.mjs)`);
      return {contents: text.replace(PROGRAM, (_, base64) => `decode64("${mended(base64)}")`), loader: 'js'};
    });
  },
};
