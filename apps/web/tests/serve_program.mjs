// SPDX-License-Identifier: Apache-2.0
// The program as a server, for tests of its page.
import {spawn} from 'node:child_process';

/// Starts the program and waits for the address that it prints: {url, child, ended, end()}. end()
/// stops it and gives its exit code.
export async function serveProgram(program, ...words) {
  const child = spawn(program, words, {stdio: ['ignore', 'pipe', 'pipe']});
  process.on('exit', () => child.kill());
  const ended = new Promise(done => child.on('exit', code => done(code)));
  let said = '';
  const url = await new Promise((done, fail) => {
    const hear = data => {
      said += data;
      const address = said.match(/http:\/\/127\.0\.0\.1:\d+\//);
      if (address) done(address[0]);
    };
    child.stdout.on('data', hear);
    child.stderr.on('data', hear);
    ended.then(code => fail(new Error(`the program ended with ${code}: ${said}`)));
  });
  return {
    url,
    child,
    ended,
    end: () => {
      child.kill('SIGINT');
      return ended;
    },
  };
}
