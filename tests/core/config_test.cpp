// SPDX-License-Identifier: Apache-2.0
// Config: reading returns what was written, and values that cannot be used are refused by name,
// line and range.
#include "gs_core/config/config.h"

#include "gs_core/config/config_diff.h"
#include "gs_core/config/config_fields.h"
#include "gs_core/config/config_presets.h"
#include "gs_core/config/config_table.h"
#include "gs_core/config/text/config_text.h"
#include "gs_core/config/text/nearest_word.h"
#include "gs_core/config/text/read_toml.h"
#include "gs_core/config/text/setting_lines.h"
#include "tests/support/temp_folder.h"
#include "tests/support/test.h"

namespace gs {
namespace {

// Stands for a value of any type in an initializer list.
struct Anything {
  template <class T>
  operator T() const;
};

// How many fields an aggregate has: the largest number of initializers it takes.
template <class T, class... Values>
constexpr std::size_t field_count() {
  if constexpr (requires { T{Values{}..., Anything{}}; }) {
    return field_count<T, Values..., Anything>();
  } else {
    return sizeof...(Values);
  }
}

// Every field as text, for comparison.
std::map<std::string, std::string> fields_of(const Config& config) {
  std::map<std::string, std::string> result;
  visit_fields(config,
               [&](const auto& field) { result[std::string(field.key)] = toml_text(field.value); });
  return result;
}

// A config in which every field differs from its default and is within its limits.
Config everything_changed() {
  Config config;
  visit_fields(config, [](const auto& field) {
    using T = std::remove_reference_t<decltype(field.value)>;
    if constexpr (std::is_same_v<T, bool>) {
      field.value = !field.value;
    } else if constexpr (std::is_same_v<T, float>) {
      field.value *= 0.9371625f;
    } else if constexpr (std::is_integral_v<T>) {
      field.value = T(double(field.value) < field.limits.high ? field.value + 1 : field.value - 1);
    } else if constexpr (std::is_enum_v<T>) {
      const T before = field.value;
      for (const Word<T>& word : Words<T>::kTable)
        if (word.value != before) field.value = word.value;
    } else if constexpr (std::is_same_v<T, std::string>) {
      field.value = "a \"quoted\" path\\with\ttab # and \x01";
    } else {
      field.value = {7, 7000, 30000};
    }
  });
  config.dataset.resolution = 640;
  config.dataset.photo_ram_gib = 6.5f;
  config.model.sh_degree = 1;
  config.model.random_box = 2;
  config.density.opacity_regularizer = config.density.scale_regularizer = 0.5f;
  config.density.prune_scale = config.density.camera_clearance = 0.5f;
  config.density.time_scale_regularizer = config.density.velocity_regularizer = 0.5f;
  config.surface.normal_weight = config.surface.photo_weight = config.surface.prior_weight = 0.5f;
  config.density.gaussians_per_point = 2;
  config.density.region = "1,0,0,-2.5";
  config.train.resolution_ramp = {4, 2};
  config.density.strategy = "mcmc";
  config.photometric.model = "gains";
  config.train.device = "cuda:12";
  config.reconstruct.camera_model = "OPENCV";
  return config;
}

std::string message_of(const std::function<void()>& call) {
  try {
    call();
  } catch (const UsageError& error) {
    return error.what();
  } catch (const Error& error) {
    return std::string("not a usage error: ") + error.what();
  }
  return "no error";
}

class ConfigFile : public ::testing::Test {
 protected:
  // Loads a file with this text over the defaults.
  Config load(const std::string& text) {
    write_bytes(file_, text);
    Config config;
    load_config(config, file_);
    return config;
  }
  std::string refusal(const std::string& text) {
    return message_of([&] { load(text); });
  }
  std::filesystem::path path(const std::string& name) { return folder_.path() / name; }

 private:
  TempFolder folder_;
  std::filesystem::path file_ = folder_.path() / "run.toml";
};

TEST(Config, EveryFieldHasKeyMeaningAndADefaultWithinItsLimits) {
  validate(Config{});
  const Config config;
  visit_fields(config, [](const auto& field) {
    EXPECT_NE(field.key.find('.'), field.key.npos) << field.key;
    EXPECT_FALSE(field.meaning.empty()) << field.key;
  });
}

TEST(Config, TheListHoldsEveryFieldOfTheStructs) {
  constexpr std::size_t kFields =
      field_count<DatasetConfig>() + field_count<ReconstructConfig>() + field_count<ModelConfig>() +
      field_count<RenderConfig>() + field_count<LossConfig>() + field_count<PhotometricConfig>() +
      field_count<PosesConfig>() + field_count<SurfaceConfig>() + field_count<OptimizerConfig>() +
      field_count<DensityConfig>() + field_count<TrainConfig>() + field_count<EvalConfig>();
  EXPECT_EQ(fields_of(Config{}).size(), kFields);
  EXPECT_EQ(field_count<Config>(), 12u);
}

TEST(Config, EveryFieldOfTheListIsItsOwn) {
  const auto before = fields_of(Config{}), after = fields_of(everything_changed());
  for (const auto& [key, value] : before) EXPECT_NE(value, after.at(key)) << key;
}

TEST_F(ConfigFile, PrintedConfigReadsBackEqualAsItIsAndWithEveryFieldChanged) {
  Config changed = everything_changed();
  changed.loss.kind = Config{}.loss.kind;  // there is only one word so far
  changed.render.order = RenderOrder::z;   // the other one refuses values of other fields
  validate(changed);
  for (const Config& config : {Config(), changed})
    EXPECT_EQ(fields_of(load(to_toml(config))), fields_of(config));
}

TEST_F(ConfigFile, KeepsWhatItDoesNotName) {
  const Config config = load("[density]\nevery = 250\n");
  EXPECT_EQ(config.density.every, 250);
  EXPECT_EQ(config.density.from_step, Config{}.density.from_step);
}

TEST_F(ConfigFile, TakesHyphensForUnderscoresAndWholeNumbersForFractions) {
  const Config config = load("[train]\nsteps-scaler = 2\nsave-steps = [10, 20]\n");
  EXPECT_EQ(config.train.steps_scaler, 2.0f);
  EXPECT_EQ(config.train.save_steps, (std::vector<int>{10, 20}));
}

/// A text that is refused, and parts of the error.
struct Refused {
  const char* text;
  std::vector<std::string> parts;
};

TEST_F(ConfigFile, WhatCannotBeUsedIsNamedWithItsLineItsValueAndTheRemedy) {
  const Refused all[] = {
      {"[density]\n\nevry = 3\n", {"run.toml:3: ", "density.evry", "did you mean density.every?"}},
      {"[densty]\nevery = 3\n", {"did you mean density.every?"}},
      {"[train]\nlambda_dssim = 0.1\n", {"did you mean loss.lambda_dssim?"}},
      {"iterations = 3\n", {"did you mean train.iterations?"}},
      // values of another type
      {"[train]\niterations = 'many'\n",
       {"run.toml:2: train.iterations", "many", "a whole number"}},
      {"[train]\niterations = 7.5\n", {"a whole number"}},
      {"[dataset]\neval = 1\n", {"true or false"}},
      {"[dataset]\nsource = 1\n", {"text in quotes"}},
      {"[train]\nsave_steps = 7\n", {"a list of whole numbers"}},
      {"[train]\nsave_steps = [7, 'x']\n", {"a list of whole numbers"}},
      // values out of range, also out of that of their type
      {"[model]\nsh_degree = 4\n", {"run.toml:2: model.sh_degree = 4", "from 0 to 3"}},
      {"[train]\nlog_every = 0\n", {"from 1 to 2147483647"}},
      {"[render]\nbackground = 'blue'\n", {"one of black, white, random"}},
      {"[train]\niterations = 4294967297\n", {"from 0 to 2147483647"}},
      {"[train]\nseed = -1\n", {"train.seed = -1"}},
      {"[render]\nfar_plane = 1e39\n", {"render.far_plane"}},
      {"[render]\nfar_plane = inf\n", {"render.far_plane"}},
      {"[loss]\nlambda_dssim = nan\n", {"loss.lambda_dssim"}},
      // text that is no TOML
      {"[train]\niterations = \n", {"run.toml:2: "}},
      {"[train]\ndevice = 1979-05-27Tcuda:0\n",
       {"run.toml:2: a key or value has a : and no quotes"}},
      {"[dataset]\nsource = \"\"\"\\\n \xC2\xA7\"\"\"\n",
       {"run.toml:2: a \\ in a string of several lines is followed by a letter"}},
      {"[dataset]\nsource = \"\"\"a\"\"\"\" \xC2\xA7\n",
       {"run.toml:2: a key or value has letters beyond ASCII and no quotes"}},
      {"[train]\nseed = 1['\xCC\xAA']\n", {":2: a list or table follows a"}},
      {"[train]\nseed = 1='\xCC\xAA'\n", {":2: a value has a = and no"}},
      {"[train]\nsave_steps = [1\nseed = 1\n", {":3: a = stands inside of a list"}}};
  for (const auto& [text, parts] : all)
    for (const std::string& part : parts) EXPECT_THAT(refusal(text), HasSubstr(part)) << text;
}

TEST_F(ConfigFile, ATableWhoseNameIsNoNameIsRefused) {
  for (const char* name :
       {"[$train]", "[[$train]]", "[ =", "[\n]", "\xEF\xBB\xBF[.a]", " [\xC3\xA4]"})
    EXPECT_THAT(refusal(std::string(name) + "\nseed = 1\n"), HasSubstr("run.toml:1: ")) << name;
  EXPECT_NO_THROW(load("[ \"train\" ]\nsave_steps = [\n  1,\n  2]\n['model']\nsh_degree = 2\n"));
}

TEST_F(ConfigFile, LettersBeyondAsciiStandInsideOfStrings) {
  EXPECT_NO_THROW(load("[dataset]\nsource = \"\"\"\\\n  a\xC3\xA4\"\"\"\n"));
  for (const char* value : {"1\"\xCC\xAA\"", "+'\xCC\xAA'", "1.\"\xCC\xAA\"", "[\n1.'\xCC\xAA']",
                            "1979-05-27 '\xCC\xAA'"})
    EXPECT_THAT(refusal(std::string("[train]\nseed = ") + value + "\n"),
                HasSubstr(": a string follows a number or a word without quotes"))
        << value;
  EXPECT_NO_THROW(load("train.\"seed\" = 1\n"));
  EXPECT_NO_THROW(
      parse_toml("t = {a.'b' = 1, 'c' = [1, 'd',\n'e'], \"f\".'g' = ''}\n'h' = 2\n", "t"));
}

TEST_F(ConfigFile, ARefusedFileChangesNothing) {
  write_bytes(path("half.toml"), "[train]\niterations = 7\nsed = 1\n");
  Config config;
  EXPECT_THROW(load_config(config, path("half.toml")), UsageError);
  EXPECT_EQ(config.train.iterations, Config{}.train.iterations);
}

TEST_F(ConfigFile, ABaseIsReadFirstAndFoundBesideTheFile) {
  write_bytes(path("sub/base.toml"), "[train]\niterations = 7\nseed = 7\n");
  const Config config = load("base = 'sub/base.toml'\n[train]\nseed = 8\n");
  EXPECT_EQ(config.train.iterations, 7);
  EXPECT_EQ(config.train.seed, 8u);
}

TEST_F(ConfigFile, ACircleOfBasesIsRefusedWithItsChain) {
  write_bytes(path("other.toml"), "base = 'run.toml'\n");
  EXPECT_THAT(refusal("base = 'other.toml'\n"),
              AllOf(HasSubstr("its own base"),
                    HasSubstr(path("run.toml").string() + " -> " + path("other.toml").string() +
                              " -> " + path("run.toml").string())));
  EXPECT_THAT(refusal("base = 'run.toml'\n"), HasSubstr("its own base"));
  EXPECT_THAT(refusal("base = 'absent.toml'\n"), HasSubstr("absent.toml"));
}

TEST_F(ConfigFile, AMissingBaseNamesWhoWantedItAndTheNearestPreset) {
  write_bytes(path("sub/middle.toml"), "base = 'low_memry'\n");
  EXPECT_THAT(refusal("base = 'sub/middle.toml'\n"),
              AllOf(HasSubstr("base of " + path("sub/middle.toml").string()),
                    HasSubstr("run.toml -> "), HasSubstr("did you mean the preset low_memory?")));
}

TEST_F(ConfigFile, AnErrorInABaseNamesTheBasesFileAndLine) {
  write_bytes(path("sub/base.toml"), "[train]\n\niteratons = 7\n");
  EXPECT_THAT(refusal("base = 'sub/base.toml'\n[train]\nseed = 8\n"),
              AllOf(HasSubstr("sub/base.toml:3: "), HasSubstr("did you mean train.iterations?")));
}

TEST_F(ConfigFile, APresetIsFoundByNameAndAFileOfThatNameWins) {
  EXPECT_EQ(load("base = 'fast'\n").train.epochs, 50);
  EXPECT_EQ(load("base = 'fast.toml'\n").train.epochs, 50);
  write_bytes(path("fast.toml"), "[train]\nepochs = 5\n");
  EXPECT_EQ(load("base = 'fast.toml'\n").train.epochs, 5);
  EXPECT_EQ(load("base = 'fast'\n").train.epochs, 50);
}

// Runs from before train.most_iterations have 0 in place of the rule that they followed.
TEST_F(ConfigFile, TheConfigOfAnOlderRunIsRead) {
  const Config config = load("[train]\niterations = 4300\nepochs = 0\nleast_iterations = 0\n");
  validate(config);
  EXPECT_EQ(config.train.iterations, 4300);
}

TEST_F(ConfigFile, TheFolderOfARunStandsForItsConfig) {
  write_bytes(path("out/config.toml"), "[train]\niterations = 11\n");
  EXPECT_EQ(load("base = 'out'\n").train.iterations, 11);
}

TEST_F(ConfigFile, EachValueKnowsTheFileAndLineItComesFrom) {
  write_bytes(path("base.toml"), "base = 'fast'\n[train]\nseed = 7\nlog_every = 3\n");
  write_bytes(path("run.toml"), "base = 'base.toml'\n\n[train]\nlog-every = 4\n");
  Config config;
  SettingOrigins origins;
  load_config(config, path("run.toml"), &origins);
  EXPECT_EQ(origins.size(), 6u);
  EXPECT_THAT(origins.at("train.epochs"), HasSubstr("preset fast:"));
  EXPECT_EQ(origins.at("train.seed"), path("base.toml").string() + ":3");
  EXPECT_EQ(origins.at("train.log_every"), path("run.toml").string() + ":4");
}

TEST(Preset, EachIsAFileOfTheFolderSaysWhatItIsForAndIsValid) {
  std::size_t files = 0;
  for (const auto& entry :
       std::filesystem::directory_iterator(std::filesystem::path(GS_SOURCE_DIR) / "configs"))
    files += entry.path().extension() == ".toml";
  EXPECT_EQ(presets().size(), files)
      << "a file of configs/ is not in the list of gs_core/CMakeLists.txt";
  for (const Preset& preset : presets()) {
    const auto file =
        std::filesystem::path(GS_SOURCE_DIR) / "configs" / (std::string(preset.name) + ".toml");
    EXPECT_EQ(preset.text, read_bytes(file));
    EXPECT_TRUE(preset.text.starts_with("# ")) << preset.name;
    Config by_name, by_file;
    load_config(by_name, std::string(preset.name));
    load_config(by_file, file);
    validate(by_name);
    EXPECT_EQ(fields_of(by_name), fields_of(by_file));
    EXPECT_NE(fields_of(by_name), fields_of(Config{})) << preset.name;
  }
}

TEST(ConfigTable, TheDocumentIsUpToDate) {
  const auto file = std::filesystem::path(GS_SOURCE_DIR) / "docs/reference/settings.md";
  EXPECT_TRUE(read_bytes(file) == config_markdown())
      << file << " is not what the code says; write it anew with\n"
      << "  build/default/bin/gemsplat config --markdown > docs/reference/settings.md";
}

TEST(ConfigTable, ExplainsASettingASectionOrEverything) {
  Config config;
  config.density.every = 50;
  const std::string one = explain(config, {{"density.every", "a.toml:3"}}, "density.every");
  EXPECT_THAT(one, AllOf(HasSubstr("density.every = 50"), HasSubstr("a.toml:3"), HasSubstr("steps"),
                         HasSubstr("at least 1"), HasSubstr("default  100"), HasSubstr("Kerbl")));
  const auto settings = [&](const std::string& wanted) {
    const std::string text = explain(config, {}, wanted);
    std::size_t count = 0;
    for (std::size_t at = 0; (at = text.find("  default  ", at)) != text.npos; ++at) ++count;
    return count;
  };
  EXPECT_EQ(settings("loss"), field_count<LossConfig>());
  EXPECT_EQ(settings(""), fields_of(config).size());
  EXPECT_EQ(message_of([&] { explain(config, {}, "densty"); }),
            "there is no section of settings densty; did you mean density?");
  EXPECT_THAT(message_of([&] { explain(config, {}, "density.evry"); }),
              HasSubstr("did you mean density.every?"));
}

TEST(ConfigTable, DifferenceNamesBothValuesAndWhereTheyComeFrom) {
  Config a, b;
  b.train.seed = 7;
  EXPECT_EQ(difference(a, {}, b, {{"train.seed", "--set"}}),
            "train.seed = 42 -> 7  (default -> --set)\n");
  EXPECT_EQ(difference(a, {}, a, {}), "");
}

TEST(ConfigDiff, NamesEachChangedSettingWithBothValuesInTheOrderOfTheList) {
  Config a, b;
  b.train.seed = 7;
  b.render.background = Background::white;
  b.loss.lambda_dssim = 0.25f;
  const std::vector<SettingChange> changes = config_diff(a, b);
  ASSERT_EQ(changes.size(), 3u);
  EXPECT_EQ(changes[0].key, "render.background");
  EXPECT_EQ(changes[0].a, "\"black\"");
  EXPECT_EQ(changes[0].b, "\"white\"");
  EXPECT_EQ(changes[1].key, "loss.lambda_dssim");
  EXPECT_EQ(changes[1].b, "0.25");
  EXPECT_EQ(changes[2].key, "train.seed");
  EXPECT_TRUE(config_diff(b, b).empty());
}

TEST(ConfigDiff, KnowsWhichChangesTheResultAndWhichMayComeOnResume) {
  const auto change_of = [](const std::string& assignment) {
    Config changed;
    apply_setting(changed, assignment);
    return config_diff(Config{}, changed).at(0);
  };
  for (const char* same : {"train.log_every=7", "train.threads=3", "train.checkpoint_every=9",
                           "dataset.photo_cache=none", "model.output=elsewhere"}) {
    EXPECT_FALSE(change_of(same).affects_result()) << same;
    EXPECT_TRUE(change_of(same).may_change_on_resume()) << same;
  }
  for (const char* later : {"train.iterations=9", "train.extra_steps=9", "density.max_gaussians=9",
                            "train.test_steps=[9]"}) {
    EXPECT_TRUE(change_of(later).affects_result()) << later;
    EXPECT_TRUE(change_of(later).may_change_on_resume()) << later;
  }
  for (const char* other : {"train.seed=7", "render.bounds=box", "density.every=9"}) {
    EXPECT_TRUE(change_of(other).affects_result()) << other;
    EXPECT_FALSE(change_of(other).may_change_on_resume()) << other;
  }
  Config logged;
  logged.train.log_every = 7;
  EXPECT_TRUE(same_result(Config{}, logged));
  logged.train.seed = 7;
  EXPECT_FALSE(same_result(Config{}, logged));
}

// Every word is read as its own value and printed as itself; other words are refused.
TEST(ConfigWords, EachWordStandsForItsOwnValueAndOthersAreRefused) {
  Config config;
  std::size_t settings = 0;
  visit_fields(config, [&](const auto& field) {
    using T = std::remove_reference_t<decltype(field.value)>;
    if constexpr (std::is_enum_v<T>) {
      ++settings;
      const std::string key(field.key);
      std::set<T> values;
      for (const Word<T>& word : Words<T>::kTable) {
        apply_setting(config, key + "=" + std::string(word.text));
        EXPECT_EQ(field.value, word.value) << key;
        EXPECT_EQ(toml_text(field.value), '"' + std::string(word.text) + '"') << key;
        EXPECT_TRUE(values.insert(word.value).second) << key << " = " << word.text;
      }
      EXPECT_EQ(values.size(), std::size(Words<T>::kTable)) << key;
      EXPECT_FALSE(value_of_word<T>("nonsense").has_value());
      EXPECT_THAT(message_of([&] { apply_setting(config, key + "=nonsense"); }),
                  AllOf(HasSubstr(key + " = \"nonsense\""),
                        HasSubstr("one of " + std::string(joined_words<T>()))));
    }
  });
  EXPECT_EQ(settings, 15u);
}

TEST(Setting, TakesTomlValuesAndBareWords) {
  Config config;
  apply_setting(config, "render.background=white");
  apply_setting(config, "density.every = 50");
  apply_setting(config, "train.save-steps=[1, 2]");
  apply_setting(config, "loss.lambda_dssim=2e-1");
  apply_setting(config, "dataset.eval=true");
  apply_setting(config, "dataset.images=2024");
  apply_setting(config, "dataset.source=a=b # c");
  EXPECT_EQ(config.render.background, Background::white);
  EXPECT_EQ(config.density.every, 50);
  EXPECT_EQ(config.train.save_steps, (std::vector<int>{1, 2}));
  EXPECT_EQ(config.loss.lambda_dssim, 0.2f);
  EXPECT_TRUE(config.dataset.eval);
  EXPECT_EQ(config.dataset.images, "2024");
  EXPECT_EQ(config.dataset.source, "a=b # c");
}

TEST(Setting, RefusesWhatItCannotUse) {
  const Refused all[] = {{"train.seed", {"section.key=value"}},
                         {"train.sed=1", {"did you mean train.seed?"}},
                         {"train.iterations=soon", {"train.iterations", "soon", "a whole number"}},
                         {"dataset.resolution=3", {"must be 0, 1, 2, 4, 8, or from 16 to 65536"}},
                         {"train.device=tpu", {"cuda:N"}},
                         {"train.device=cuda:N", {"cuda:N"}},
                         {"train.device=cuda:", {"cuda:N"}}};
  Config config;
  for (const auto& [text, parts] : all) {
    const std::string message = message_of([&, &text = text] { apply_setting(config, text); });
    for (const std::string& part : parts) EXPECT_THAT(message, HasSubstr(part)) << text;
  }
}

TEST(Validate, ChecksFieldsAgainstEachOther) {
  Config config;
  config.render.near_plane = config.render.far_plane;
  EXPECT_THAT(message_of([&] { validate(config); }), HasSubstr("render.near_plane"));
  config = {};
  config.dataset.resolution = 3;
  EXPECT_THAT(message_of([&] { validate(config); }), HasSubstr("1, 2, 4, 8"));
  config = {};
  config.render.order = RenderOrder::pixel;
  EXPECT_EQ(message_of([&] { validate(config); }), "no error");
  config.model.dynamic = true;
  EXPECT_THAT(message_of([&] { validate(config); }), HasSubstr("model.dynamic"));
  config.model.dynamic = false;
  config.density.strategy = "fastgs";
  EXPECT_THAT(message_of([&] { validate(config); }), HasSubstr("density.strategy"));
  config.density.strategy = "growth";
  config.dataset.lens = LensUse::native;
  EXPECT_THAT(message_of([&] { validate(config); }), HasSubstr("dataset.lens"));
  config = {};
  config.train.steps_scaler = 1e-6f;
  EXPECT_THAT(message_of([&] { validate(config); }), HasSubstr("train.steps_scaler"));
  EXPECT_THAT(message_of([&] {
                validate(config, {{"train.steps_scaler", "a.toml:2"}});
              }),
              HasSubstr("a.toml:2: train.steps_scaler"));
  config = {};
  config.train.extra_steps = 2'147'483'647;
  EXPECT_THAT(message_of([&] { validate(config); }),
              AllOf(HasSubstr("train.extra_steps"), Not(HasSubstr("scaler"))));
}

TEST(Validate, RefusesTheCharacterThatEndsNames) {
  Config config;
  config.model.output = std::string("out\0put", 7);
  EXPECT_THAT(message_of([&] { validate(config); }),
              AllOf(HasSubstr("model.output"), HasSubstr("\\u0000")));
}

TEST(TomlText, IsOneLineThatReadsBack) {
  const std::string text =
      R"([0.01, -0.5, 7, -3, true, "a\"b\\c", [], {"k.1" = 1e-30, "l" = [2.0]}, 1979-05-27])";
  const toml::table table = parse_toml("x = " + text, "text");
  EXPECT_EQ(text_of(*table.get("x")), text);
}

TEST(NearestWord, CountsEditsAndKnowsWhenNothingIsNear) {
  EXPECT_EQ(edit_distance("kitten", "sitting"), 3);
  EXPECT_EQ(edit_distance("", "abc"), 3);
  EXPECT_EQ(nearest_word("iteratons", {"images", "iterations"}), "iterations");
  EXPECT_EQ(nearest_word("zebra", {"images", "iterations"}), "");
}

TEST(Config, KeysAndWordsOfOlderRunsAreTaken) {
  Config config;
  apply_setting(config, "density.opacity_regulariser=0.25");
  apply_setting(config, "density.scale-regulariser=0.5");
  apply_setting(config, "optimizer.moments=tiny");
  EXPECT_EQ(config.density.opacity_regularizer, 0.25f);
  EXPECT_EQ(config.density.scale_regularizer, 0.5f);
  EXPECT_EQ(config.optimizer.moments, MomentStorage::halves);
  EXPECT_EQ(config_of_lines("optimizer.moments = \"tiny\"\n").optimizer.moments,
            MomentStorage::halves);
}

TEST(Config, SettingsOfOlderVersionsAreReadOverWhereTheyChangedNothing) {
  Config config;
  for (const char* const constant :
       {"optimizer.lazy=auto", "train.offload=none", "photometric.vignetting=false",
        "density.pooling=sum", "render.precision=full", "optimizer.beta2=0.999",
        "density.static_after=0.0", "optimizer.time_color_lr=0.0025", "train.morton_every=5000",
        "train.morton_until=15000", "optimizer.position_decay_from=0",
        "optimizer.time_mean_lr=0.0008", "model.most_points=2000000", "poses.warmup=1000",
        "poses.pull=0.0001", "loss.depth_weight_final=0.002", "density.noise_scale=500000.0"})
    apply_setting(config, constant);
  EXPECT_EQ(to_toml(config), to_toml(Config()));
  EXPECT_THAT(error_of([&] { apply_setting(config, "poses.pull=3"); }),
              HasSubstr("poses.pull = 3 cannot be used: the pull to the given poses"));
  EXPECT_THAT(error_of([&] { apply_setting(config, "optimizer.moments=compact"); }),
              HasSubstr("optimizer.moments = \"compact\" cannot be used: moments in 32 bits"));
  EXPECT_THAT(error_of([&] { apply_setting(config, "photometric.model=ppisp"); }),
              HasSubstr("no better than gains"));
  EXPECT_THAT(
      error_of([&] { apply_setting(config, "optimizer.lazy=on"); }),
      HasSubstr("optimizer.lazy = \"on\" cannot be used: updates of SH are no longer left"));
}

TEST_F(ConfigFile, RulesOfOlderVersionsAreReadAsTheMethodThatHasThem) {
  const std::string of_adaptive =
      "base = 'adaptive'\n[density]\nstrategy = 'budgeted'\nmax_gaussians = 9\n";
  EXPECT_EQ(load(of_adaptive).density.strategy, "adaptive");
  EXPECT_EQ(
      load(of_adaptive + "score = 'error'\nselect = 'race'\ncurve = 'parabola'\n").density.strategy,
      "taming");
  EXPECT_EQ(load(of_adaptive + "soft_prune = 0.8\nhard_prune = 0.3\nshare_prune_from = 6000\n"
                               "share_prune_every = 3000\nshare_prune_until = 27000\n")
                .density.strategy,
            "speedy_splat");
  EXPECT_EQ(load("base = 'adaptive'\n[density]\nabsolute_gradient = true\n").density.strategy,
            "absgs");
  EXPECT_EQ(load("[density]\nstrategy = 'budgeted'\nscore = 'force'\nmost_growth = 0.3\n"
                 "child_opacity_factor = 0.7\nramp_from = 16.0\n")  // of another curve
                .density.strategy,
            "growth");
  // They had no effect under these strategies.
  EXPECT_EQ(load("[density]\nstrategy = 'adaptive'\nscore = 'force'\nsplit = 'variance'\n"
                 "window = 'refinement'\n")
                .density.strategy,
            "adaptive");
  EXPECT_EQ(load("base = 'mcmc'\n[density]\nstrategy = 'mcmc'\nsplit = 'axis'\n").density.strategy,
            "mcmc");
}

TEST(SettingLines, OfACheckpointOfAnOlderRunAreReadAsItsMethod) {
  const std::string lines =
      "density.curve = \"root\"\ndensity.absolute_gradient = true\ndensity.score = \"edge\"\n"
      "density.select = \"race\"\ndensity.small_scale = 0.0\ndensity.strategy = \"budgeted\"\n"
      "density.window = \"refinement\"\ndensity.most_growth = 1.0\n"
      "density.child_opacity_factor = 0.6\ndensity.opacity_policy = \"reset\"\n"
      "density.opacity_amount = 0.05\ndensity.opacity_clears = \"opacity\"\n"
      "density.recovery_prune = 0.2\ndensity.recovery_after = 300\n"
      "density.recovery_until = 6000\ntrain.seed = 7\n";
  EXPECT_EQ(config_of_lines(lines).density.strategy, "improved_gs");
  EXPECT_EQ(config_of_lines(lines).train.seed, 7u);
  Config changed = everything_changed();
  changed.loss.kind = Config().loss.kind;  // the only word that there is
  EXPECT_EQ(to_toml(config_of_lines(setting_lines(changed))), to_toml(changed));
}

TEST_F(ConfigFile, RulesThatNoMethodHasAreRefusedWithTheirPlaceAndTheNearestMethod) {
  EXPECT_THAT(refusal("base = 'paper_litegs'\n[density]\nstrategy = 'budgeted'\n"
                      "keep_parent = false\n"),
              AllOf(HasSubstr(":4: density.keep_parent = false cannot be used"),
                    HasSubstr("the nearest is litegs"), HasSubstr("docs/develop/extending.md")));
  EXPECT_THAT(refusal("[density]\nscore = 'errors'\n"), HasSubstr("density.score = \"errors\""));
  EXPECT_THAT(refusal("[density]\nscore_threshold = 'high'\n"),
              HasSubstr("density.score_threshold = \"high\""));
  Config config;
  EXPECT_THAT(error_of([&] { apply_setting(config, "density.most_growth=0.4"); }),
              HasSubstr("density.most_growth = 0.4 cannot be used: it is a constant of a method"));
  EXPECT_THAT(error_of([&] { apply_setting(config, "density.strategy=budgeted"); }),
              HasSubstr("its methods have names of their own"));
  apply_setting(config, "density.most_growth=0.3");
  EXPECT_EQ(to_toml(config), to_toml(Config()));
}

}  // namespace
}  // namespace gs
