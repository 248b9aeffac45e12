// SPDX-License-Identifier: Apache-2.0
// Fixes two bugs of Spark 2.2.0 while it is bundled. First, Spark packs three SH coefficients into 8
// bits each, with a shared exponent. It rounds log2 of the largest coefficient down instead of up, so
// that coefficients above that power of two are clipped, by up to half of their value. In its
// WebAssembly this rounding is the sequence "f32.floor, f32.const 15", which occurs nowhere else.
// Second, models that it streams in full precision have two textures for the SH of degree 3, and it
// makes the first alone.
import {readFile} from 'node:fs/promises';

const DOWN = '8e4300007041',
  UP = '8d4300007041'; // f32.floor or f32.ceil, then f32.const 15
const PLACES = 30; // the function is inlined this often
const THREE_TEXTURES = 'const numSh = Math.min(shArrays.length, 3);',
  ALL_TEXTURES = 'const numSh = shArrays.length;';
const PROGRAM = /decode64\("([A-Za-z0-9+/=]+)"\)/g;

function fixed(base64) {
  const parts = Buffer.from(base64, 'base64').toString('hex').split(DOWN);
  if (parts.length !== PLACES + 1)
    throw new Error(
      `Spark's program has changed: ${parts.length - 1} places to fix, ${PLACES} were expected (apps/web/spark_fix.mjs)`,
    );
  return Buffer.from(parts.join(UP), 'hex').toString('base64');
}

export const sparkFix = {
  name: 'spark-fix',
  setup(build) {
    build.onLoad({filter: /@sparkjsdev\/spark\/dist\/spark\.module\.js$/}, async ({path}) => {
      const text = await readFile(path, 'utf8');
      if (text.match(PROGRAM)?.length !== 1)
        throw new Error(`Spark's program was not found in ${path} (apps/web/spark_fix.mjs)`);
      if (text.split(THREE_TEXTURES).length !== 2)
        throw new Error(
          `Spark's textures of SH were not found in ${path} (apps/web/spark_fix.mjs)`,
        );
      return {
        contents: text
          .replace(THREE_TEXTURES, ALL_TEXTURES)
          .replace(PROGRAM, (_, base64) => `decode64("${fixed(base64)}")`),
        loader: 'js',
      };
    });
  },
};
