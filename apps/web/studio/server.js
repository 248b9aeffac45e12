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
  /// Moves the project's folder, and returns where it is: {folder}.
  remove = () => post(`${this.at}remove`);
  run = words => post(`${this.at}run`, JSON.stringify({words}));
  goOn = job => post(`${this.at}go_on?id=${job}`);
  stop = job => post(`${this.at}stop?id=${job}`);
  /// The JSON of config, info, doctor, or of edit --dry-run.
  question = words => post(`${this.at}ask`, JSON.stringify({words}));
  /// Keeps what a tool of the viewer has written, a path or a lasso, and returns its file.
  keep = async (name, json) =>
    (await post(`${this.at}keep?${query({name})}`, JSON.stringify(json))).file;
  /// The address of a frame that shows a model of some time: the words are those behind `gemsplat
  /// view`.
  view = async (words, time) =>
    `view/${(await post(`${this.at}view?time=${time}`, JSON.stringify({words}))).port}/`;
  /// That of a run, with the secret of its buttons.
  live = async job => `${this.at}live/${job}/${(await post(`${this.at}live?id=${job}`)).hash}`;
  uploaded = (name, of) => ask(`${this.at}upload?${query({name, of})}`);
  upload = (name, at, of, piece) => post(`${this.at}upload?${query({name, at, of})}`, piece);
  /// A small picture of a photo that is turned clockwise by so many degrees; a large one to paint on.
  thumb = (name, turn = 0, isLarge = false) =>
    `${this.at}thumb?${query({name, turn, ...(isLarge && {large: 1})})}`;
  /// Its mask, which was painted at that time.
  mask = (name, turn, time) => `${this.at}mask?${query({name, turn, time})}`;
  paint = (name, turn, png) => post(`${this.at}mask?${query({name, turn})}`, png);
  file = path => `${this.at}file/${path.split('/').map(encodeURIComponent).join('/')}`;
}
