// SPDX-License-Identifier: Apache-2.0
// The page's requests to the studio (docs/reference/studio_http.md). Every failure becomes an Error
// whose message is a sentence.

const GONE =
  'The studio has ended. Start gemsplat studio again, and open the address that it prints.';

async function ask(address, options = {}) {
  let response;
  try {
    response = await fetch(address, {cache: 'no-store', ...options});
  } catch {
    throw Object.assign(new Error(GONE), {isGone: true});
  }
  if (response.ok) return response.json();
  const words = (await response.text().catch(() => '')).trim();
  throw Object.assign(new Error(words || `The studio answered with ${response.status}.`), {
    isGone: response.status === 403,
  });
}

const query = words =>
  Object.entries(words)
    .map(([name, value]) => `${name}=${encodeURIComponent(value)}`)
    .join('&');
const post = (address, body) => ask(address, {method: 'POST', body});

export const askForState = () => ask('state');
export const createProject = (name, photos = '') => post(`new?${query({name, photos})}`);

/// What can be asked of one project.
export class ProjectServer {
  constructor(id) {
    this.id = id;
    this.at = `p/${encodeURIComponent(id)}/`;
  }
  details = () => ask(this.at);
  said = job => ask(`${this.at}job?id=${job}`);
  change = changes => post(`${this.at}change`, JSON.stringify(changes));
  run = words => post(`${this.at}run`, JSON.stringify({words}));
  goOn = job => post(`${this.at}go_on?id=${job}`);
  stop = job => post(`${this.at}stop?id=${job}`);
  /// The JSON of config, info, doctor, or of edit --dry-run.
  question = words => post(`${this.at}ask`, JSON.stringify({words}));
  keepPath = async path => (await post(`${this.at}path`, JSON.stringify(path))).file;
  /// The address of a frame that shows a model of some time: the words are those behind `gemsplat
  /// view`.
  view = async (words, time) =>
    `view/${(await post(`${this.at}view?time=${time}`, JSON.stringify({words}))).port}/`;
  /// That of a run, with the secret of its buttons.
  live = async job => `${this.at}live/${job}/${(await post(`${this.at}live?id=${job}`)).hash}`;
  uploaded = (name, of) => ask(`${this.at}upload?${query({name, of})}`);
  upload = (name, at, of, piece) => post(`${this.at}upload?${query({name, at, of})}`, piece);
  thumb = name => `${this.at}thumb?${query({name})}`;
  file = path => `${this.at}file/${path.split('/').map(encodeURIComponent).join('/')}`;
}
