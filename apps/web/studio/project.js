// SPDX-License-Identifier: Apache-2.0
// The name of a project, and its removal, which moves its folder and deletes nothing.
import {el} from '../shared/dom.js';
import {button} from './jobs.js';
import {cleanName} from './start.js';

export function projectSettings(app) {
  const name = el('input', {type: 'text', id: 'project-name', value: app.project.name}),
    rename = () => app.act(server => server.change({name: cleanName(name.value)}));
  const remove = () => {
    const {server, project, state} = app;
    // Before the project goes, for its card and its screens would ask for it.
    state.projects = state.projects.filter(each => each !== project);
    location.hash = '';
    return app.act(async () => {
      const {folder} = await server.remove();
      app.removed = `${project.name} was moved to ${folder}. Move the folder back, and it is here again.`;
    });
  };
  const confirm = el(
    'div.confirm',
    {role: 'group', 'aria-label': 'removal', hidden: true},
    el(
      'p',
      {},
      'The project goes from this page. Its folder moves to ',
      el('code', {}, `${app.state.folder}/removed`),
      ', and nothing in it is deleted.',
    ),
    el(
      'div.buttons',
      {},
      button('Remove it', remove, 'primary'),
      button('Keep it', () => (confirm.hidden = true)),
    ),
  );
  const ask = () => {
    confirm.hidden = false;
    confirm.querySelector('button').focus();
  };
  return el(
    'details.card.project-settings',
    {},
    el('summary', {}, 'Rename or remove this project'),
    el('label.field', {for: name.id}, el('span', {}, 'Name'), name),
    el('div.buttons', {}, button('Rename', rename), button('Remove the project', ask)),
    confirm,
  );
}
