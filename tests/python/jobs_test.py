# SPDX-License-Identifier: Apache-2.0
"""gemsplat.jobs: the verbs of the program as functions, made from the program's own lists of options."""

import ast
import inspect
import json
import os
import re
import subprocess
import sys
import unittest
from pathlib import Path

import gemsplat
import gemsplat.compat
from support import COURTYARD, SMALL_FLAGS, SOURCE, TestCase, random_arrays, run_program

SAID_ELSEWHERE = {"help", "help_all", "json", "progress", "quiet", "verbose"}
QUICK = {"resolution": 8, "device": "cpu", "iterations": 12, "max_gaussians": 3000, "eval": True}


def manual():
    """{"train": {"output": ("folder of the run", takes a value)}, ...}: what `self-doc --markdown` says."""
    verbs = {}
    for section in run_program("self-doc", "--markdown").split("\n### gemsplat ")[1:]:
        heading, rows = section.split("\n")[0], {}
        for cell, meaning in re.findall(r"^\| `(.*?)` \| (.*) \|$", section, re.M):
            *names, last = cell.split(", ")
            last, _, value = last.partition(" ")
            long = [name[2:] for name in [*names, last] if name.startswith("--") and name != "--from"]
            keyword = (long[0] if long else last).replace("-", "_")
            if keyword not in SAID_ELSEWHERE and meaning not in [known for known, _ in rows.values()]:
                rows[keyword] = (meaning.replace("\\|", "|"), bool(value))
        parent = verbs[heading.split(" ")[0]] if " " in heading else {}  # of a sub-verb
        verbs[re.sub("[ -]", "_", heading)] = {**parent, **rows}
    return verbs


class Lists(TestCase):
    @classmethod
    def setUpClass(cls):
        cls.manual = manual()

    def test_every_verb_is_a_function(self):
        self.assertEqual(set(gemsplat.jobs.__all__), set(self.manual))
        self.assertGreater(len(self.manual), 15)

    def test_keywords_and_their_meanings_are_those_of_the_manual(self):
        for verb, expected in self.manual.items():
            function = getattr(gemsplat.jobs, verb)
            parameters = dict(inspect.signature(function).parameters)
            self.assertEqual(str(parameters.pop("progress")).split(":")[0], "progress", verb)
            self.assertEqual(set(parameters), set(expected), verb)
            doc = dict(line.split(": ", 1) for line in inspect.getdoc(function).split("\n")[2:])
            for name, (meaning, takes_value) in expected.items():
                self.assertEqual(doc[name], meaning, (verb, name))
                is_truth = parameters[name].annotation in ("bool", "Optional[bool]")
                self.assertEqual(is_truth, not takes_value, (verb, name))

    def test_functions_on_arrays_have_the_keywords_of_their_verbs(self):
        pairs = [(gemsplat.train, "train"), (gemsplat.render, "render"), (gemsplat.evaluate, "eval"),
                 (gemsplat.export, "export"), (gemsplat.Model.save, "export"), (gemsplat.Model.edit, "edit")]
        for function, verb in pairs:
            of_verb = inspect.signature(getattr(gemsplat.jobs, verb)).parameters
            shared = [p for p in inspect.signature(function).parameters.values() if p.name in of_verb
                      and p.name not in ("scene", "model", "config", "cameras", "background")]
            self.assertGreater(len(shared), 2, verb)
            for parameter in shared:
                self.assertEqual(parameter, of_verb[parameter.name], verb)
                self.assertIn(f"\n{parameter.name}: {self.manual[verb][parameter.name][0]}", inspect.getdoc(function))

    def test_defaults_and_types_are_those_of_the_request(self):
        shown = lambda verb, name: str(inspect.signature(getattr(gemsplat.jobs, verb)).parameters[name])
        self.assertEqual(shown("experiment", "jobs"), "jobs: 'int' = 1")
        self.assertEqual(shown("experiment", "only"), "only: 'Optional[int]' = None")  # -1 is not to be given
        self.assertEqual(shown("experiment", "file"), "file: 'Text'")
        self.assertEqual(shown("edit", "decimate_by"), """decimate_by: "Literal['merge', 'drop']" = 'merge'""")
        self.assertEqual(shown("edit", "straighten"), "straighten: 'Optional[bool]' = None")
        self.assertEqual(shown("export", "up"), "up: 'Optional[Union[float, Sequence[float]]]' = None")
        self.assertEqual(shown("train", "max_gaussians"), "max_gaussians: 'Optional[Union[int, str]]' = None")
        self.assertEqual(shown("train", "resume"), "resume: 'Optional[Union[bool, Text]]' = None")
        self.assertEqual(shown("train", "force"), "force: 'bool' = False")


class Stubs(TestCase):
    """The .pyi files that the build has written."""

    def functions_of(self, name):
        tree = ast.parse((Path(gemsplat.__file__).parent / name).read_text())
        return tree, {node.name: node for node in tree.body if isinstance(node, ast.FunctionDef)}

    def assert_states(self, node, function):
        arguments, parameters = node.args, inspect.signature(function).parameters.values()
        nodes = {a.arg: a for a in [*arguments.args, *arguments.kwonlyargs, arguments.vararg, arguments.kwarg] if a}
        self.assertEqual(set(nodes), {p.name for p in parameters}, node.name)
        defaults = dict(zip([a.arg for a in arguments.args][::-1], arguments.defaults[::-1]))
        defaults.update({a.arg: d for a, d in zip(arguments.kwonlyargs, arguments.kw_defaults) if d is not None})
        for parameter in parameters:
            stated = nodes[parameter.name].annotation
            if parameter.name != "self":
                self.assertEqual(ast.unparse(stated), ast.unparse(ast.parse(parameter.annotation)), node.name)
            has_default = parameter.default is not parameter.empty
            self.assertEqual(parameter.name in defaults, has_default, (node.name, parameter.name))
            if has_default:
                self.assertEqual(ast.literal_eval(defaults[parameter.name]), parameter.default)

    def test_every_verb_is_stated_as_it_is(self):
        tree, functions = self.functions_of("jobs.pyi")
        self.assertEqual(set(functions), set(gemsplat.jobs.__all__))
        for name, node in functions.items():
            self.assert_states(node, getattr(gemsplat.jobs, name))

    def test_every_name_of_the_module_is_stated_and_no_other(self):
        tree, functions = self.functions_of("__init__.pyi")
        classes = {node.name: node for node in tree.body if isinstance(node, ast.ClassDef)}
        self.assertEqual(functions.keys() | classes.keys(), set(gemsplat.__all__) - {"jobs", "__version__"})
        for name, node in functions.items():
            if inspect.isfunction(getattr(gemsplat, name)) and name != "render":  # which has two forms
                self.assert_states(node, getattr(gemsplat, name))
        for name, node in classes.items():
            stated = {item.name for item in node.body if isinstance(item, ast.FunctionDef)}
            stated |= {item.target.id for item in node.body if isinstance(item, ast.AnnAssign)}
            found = {key for key in vars(getattr(gemsplat, name)) if not key.startswith("_")}
            self.assertEqual({key for key in stated if not key.startswith("_")}, found, name)
        text = ast.unparse(tree)
        for line in ["def means(self) -> NDArray[np.float32]", "def scales(self) -> NDArray[np.float32]",
                     "def mask(self) -> Optional[NDArray[np.uint8]]", "def train_views(self) -> List[View]",
                     "def at_time(self, time: float) -> Camera", "def snapshot(self) -> Model",
                     "camera: Iterable[Camera], *,", "-> list[Picture]"]:
            self.assertIn(line, text)
        self.assertNotIn("object", text)
        self.assertNotIn("_gemsplat", text)

    def test_the_functions_of_compat_are_stated_as_they_are(self):
        tree, functions = self.functions_of("compat/__init__.pyi")
        self.assertEqual(set(functions), set(gemsplat.compat.__all__))
        for name, node in functions.items():
            self.assert_states(node, getattr(gemsplat.compat, name))

    def test_everything_has_a_docstring(self):
        for name in gemsplat.__all__:
            if name != "__version__":
                self.assertTrue(inspect.getdoc(getattr(gemsplat, name)), name)
        self.assertRegex(gemsplat.__version__, r"^\d+\.\d+\.\d+$")


class Calls(TestCase):
    def setUp(self):
        super().setUp()
        self.model = self.folder / "model.ply"
        gemsplat.Model(**random_arrays()).save(self.model)

    def test_a_function_returns_what_the_program_prints(self):
        for verb, *words in [("info", self.model), ("info",), ("config",), ("config", "diff", "mcmc")]:
            name = "_".join([verb, *words[:1]]) if words[:1] == ["diff"] else verb
            values = words[1:] if words[:1] == ["diff"] else words
            found, expected = getattr(gemsplat.jobs, name)(*values), json.loads(run_program(verb, *words, "--json"))
            for json_object in (found, expected):
                json_object.pop("commit", None)  # program and module may be built at two times
            self.assertEqual(found, expected)

    def test_operations_apply_in_the_order_of_the_call(self):
        out = self.folder / "out.ply"
        steps = lambda **operations: [row["step"] for row in gemsplat.jobs.edit(
            self.model, output=out, force=True, **operations)["steps"]]
        self.assertEqual(steps(move=(10, 0, 0), keep=["x=9..", "x=..11"], sh_degree=1),
                         ["--move 10,0,0", "--keep x=9..", "--keep x=..11", "--sh-degree 1"])
        self.assertEqual(steps(decimate=0.5, recenter=True), ["--decimate 0.5", "--recenter"])
        self.assertEqual(len(gemsplat.load(out)), 25)

    def test_a_run_is_the_programs_and_tells_its_progress(self):
        mine, its, events = self.folder / "mine", self.folder / "its", []
        result = gemsplat.jobs.train(COURTYARD, output=mine, set={"train": {"log_every": 4}}, progress=events.append, **QUICK)
        run_program("train", COURTYARD, "-o", its, "-i", 12, "--eval", "--max-gaussians", 3000, "--set",
                    "train.log_every=4", *SMALL_FLAGS)
        ply = "point_cloud/iteration_12/point_cloud.ply"
        self.assertEqual((mine / ply).read_bytes(), (its / ply).read_bytes())
        self.assertEqual(result["results"], json.loads((mine / "results.json").read_text()))
        last = [event for event in events if event["event"] == "progress"][-1]
        self.assertEqual({"part", "unit", "done", "total"} - set(last), set())
        self.assertIn("info", {event.get("level") for event in events})

    def test_the_array_function_takes_the_same_keywords(self):
        keywords = {**QUICK, "strategy": "mcmc", "test_steps": [6]}
        result = gemsplat.train(COURTYARD, output=self.folder / "mine", **keywords)
        gemsplat.jobs.train(COURTYARD, output=self.folder / "other", **keywords)
        ply = "point_cloud/iteration_12/point_cloud.ply"
        self.assertEqual((self.folder / "mine" / ply).read_bytes(), (self.folder / "other" / ply).read_bytes())
        self.assertIn("test_steps = [6]", result.config)

    def test_an_exception_of_progress_ends_the_run_with_its_state_saved(self):
        def fail(event):
            if event.get("unit") == "step":
                raise KeyError("enough")

        with self.assertRaises(KeyError):
            gemsplat.jobs.train(COURTYARD, output=self.folder / "run", progress=fail, **{**QUICK, "iterations": 100000})
        self.assertTrue(list((self.folder / "run" / "checkpoints").glob("*.ckpt")))
        self.assertEqual(gemsplat.jobs.info()["version"], gemsplat.__version__)  # nothing is left behind

    def test_progress_cannot_begin_another_job(self):
        refused = []

        def nest(event):
            try:
                gemsplat.jobs.info()
            except gemsplat.UsageError as error:
                refused.append(str(error))

        gemsplat.jobs.train(COURTYARD, output=self.folder / "run", progress=nest, **QUICK)
        self.assertIn("cannot begin another job", refused[0])

    def test_ctrl_c_ends_a_run_and_python_goes_on(self):
        script = ("import gemsplat, os, signal, sys\n"
                  "def stop(event):\n"
                  "    if event.get('unit') == sys.argv[3]: os.kill(os.getpid(), signal.SIGINT)\n"
                  "try:\n"
                  "    gemsplat.jobs.train(sys.argv[1], output=sys.argv[2], iterations=100000, resolution=8, device='cpu',\n"
                  "                        max_gaussians=3000, progress=stop)\n"
                  "except KeyboardInterrupt:\n"
                  "    sys.exit(42)\n")
        for unit in ["step", "photo"]:  # with gemsplat's handlers, and with those of Python
            run = self.folder / unit
            done = subprocess.run([sys.executable, "-c", script, COURTYARD, run, unit], capture_output=True, text=True)
            self.assertEqual(done.returncode, 42, done.stderr)
            self.assertEqual(bool(list(run.glob("checkpoints/*.ckpt"))), unit == "step")

    def test_the_number_of_threads_stays_what_was_asked_for(self):
        self.addCleanup(gemsplat.set_threads, 0)
        gemsplat.set_threads(1)
        gemsplat.jobs.export(self.model, self.folder / "a.splat", no_measure=True)
        self.assertEqual(gemsplat.thread_count(), 1)
        gemsplat.jobs.export(self.model, self.folder / "b.splat", no_measure=True, threads=3)
        self.assertEqual(gemsplat.thread_count(), 3)

    def test_an_experiment_starts_the_program(self):
        file = self.folder / "two.toml"
        file.write_text(f'output = "{self.folder / "out"}"\nscenes = ["{COURTYARD}"]\n[set]\ntrain = {{iterations = 5, device = "cpu"}}\n'
                        'dataset = {resolution = 8}\n[[configs]]\nname = "quick"\n')
        script = ("import gemsplat, json, sys\n"
                  "try:\n"
                  "    print(json.dumps(gemsplat.jobs.experiment(sys.argv[1], dry_run=sys.argv[2:] != [])))\n"
                  "except gemsplat.Error as error:\n"
                  "    print(error, error.result['finished'])\n")
        call = lambda path, *more: subprocess.run([sys.executable, "-c", script, file, *more], capture_output=True, text=True,
                                                  env={**os.environ, "PATH": path})
        self.assertEqual([run["is_finished"] for run in json.loads(call("/none", "dry").stdout)["runs"]], [False])
        failed = call("/none")
        self.assertIn("cannot start gemsplat", failed.stderr)
        self.assertRegex(failed.stdout, "1 of the runs failed; .* 0\n")
        done = call(str(Path(os.environ["GS_PROGRAM"]).parent) + ":/usr/bin")
        self.assertEqual(json.loads(done.stdout)["finished"], 1, done.stderr)


class Refusals(TestCase):
    def refuse(self, pattern, verb, *places, **keywords):
        self.assert_refused(pattern, getattr(gemsplat.jobs, verb), *places, **keywords)

    def test_an_unknown_keyword_names_the_nearest(self):
        self.refuse("jobs.train has no keyword iteration; did you mean iterations?", "train", iteration=5)
        self.refuse("jobs.edit has no keyword straigthen; did you mean straighten?", "edit", "a.ply", straigthen=True)
        self.assert_refused("train has no keyword calback; did you mean callback?", gemsplat.train, COURTYARD, calback=5)
        self.assert_refused("save has no keyword spz_verson; did you mean spz_version?",
                            gemsplat.Model(**random_arrays()).save, "a.spz", spz_verson=3)

    def test_a_wrong_value_says_the_argument_and_what_it_takes(self):
        refuse = self.refuse
        refuse('jobs takes a whole number from 1 to 1024, and not "two": runs at a time', "experiment", "a", jobs="two")
        refuse("jobs takes a whole number from 1 to 1024, and not 0", "experiment", "a", jobs=0)
        refuse("jobs takes a whole number .*, and not 1.5", "experiment", "a", jobs=1.5)
        refuse("only takes a whole number of at least 0, and not -2", "experiment", "a", only=-2)
        refuse("force takes true or false, and not 1: ", "train", COURTYARD, force=1)
        refuse("eval takes true or false, and not \"yes\": ", "train", COURTYARD, eval="yes")
        refuse("iterations takes a whole number or a word, and not true: number of training steps", "train", COURTYARD, iterations=True)
        refuse("decimate_by takes merge or drop, and not \"magic\": ", "edit", "a.ply", decimate_by="magic")
        refuse("spz_version takes 2, 3 or 4, and not 5", "export", "a.ply", "a.spz", spz_version=5)
        refuse("output takes text, and not \\[1\\]", "eval", "a.ply", output=[1])
        refuse("up takes 3 values, and not \\[1,2\\]", "export", "a.ply", "a.spz", up=(1, 2))
        refuse("train.iterations", "train", COURTYARD, iterations=1.5)
        refuse("train.device", "train", COURTYARD, device="gpu")
        refuse("an argument cannot be a Error", "train", COURTYARD, device=gemsplat.Error())

    def test_what_goes_together_is_checked(self):
        self.refuse("viewer_port goes with viewer", "train", COURTYARD, viewer_port=8000)
        self.refuse("gather and only exclude each other", "experiment", "a", gather=True, only=1)
        with self.assertRaisesRegex(TypeError, "missing a required argument: 'model'"):
            gemsplat.jobs.edit()

    def test_errors_are_those_of_the_program(self):
        with self.assertRaisesRegex(gemsplat.Error, "absent.ply"):
            gemsplat.jobs.info(self.folder / "absent.ply")
        self.refuse("there is nothing to do", "edit", self.folder / "a.ply", output="b.ply")


if __name__ == "__main__":
    unittest.main()
