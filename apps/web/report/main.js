// SPDX-License-Identifier: Apache-2.0
// The report: reads the data that gemsplat put into the page, and shows that of a run or of an experiment.
import {el} from '../shared/dom.js';
import {showExperiment} from './experiment.js';
import {showRun} from './run.js';

const page = document.getElementById('page');
try {
  const data = JSON.parse(document.getElementById('data').textContent);
  document.title = `${data.title} · gemsplat`;
  page.replaceChildren(...(data.kind === 'experiment' ? showExperiment(data) : showRun(data)));
} catch (error) {
  page.replaceChildren(el('p.card.failure', {role: 'alert'},
                          `This report cannot be shown: ${error.message}. "gemsplat report" makes it anew.`));
  throw error;
}
