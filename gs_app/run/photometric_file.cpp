// SPDX-License-Identifier: Apache-2.0
#include "gs_app/run/photometric_file.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>

#include "gs_core/error.h"
#include "gs_core/system/byte_reader.h"
#include "gs_core/system/files/atomic_file.h"
#include "gs_core/system/text/foreign_text.h"
#include "gs_core/system/text/json.h"
#include "gs_core/system/text/read_json.h"

namespace gs {
namespace {

// float as the number type: written with the digits that a float needs. Keys are sorted.
using Names = std::vector<std::string>;

constexpr const char* kRemedyOfLooks =
    "train again, or remove the file to measure neutral pictures alone";

void add_numbers(const Names& names, const std::vector<float>& numbers, SortedFloatJson& json) {
  for (std::size_t i = 0; i < names.size(); ++i) json[names[i]] = numbers[i];
}

SortedFloatJson photos_json(const SceneLooks& looks, const Names& names, bool is_held_out) {
  SortedFloatJson json = SortedFloatJson::object();
  for (const auto& [name, look] : looks.photos) {
    if (look.is_held_out != is_held_out) continue;
    json[name]["camera"] = look.camera_id;
    add_numbers(names, look.numbers, json[name]);
  }
  return json;
}

/// Takes the parts of a file, which anybody may have edited.
class Reader {
 public:
  explicit Reader(const std::filesystem::path& path) : path_(path) {}

  SceneLooks looks() {
    const SortedFloatJson json = read_json_as<SortedFloatJson>(path_, kRemedyOfLooks);
    return take_from_json(path_, kRemedyOfLooks, [&] { return looks_in(json); });
  }

 private:
  SceneLooks looks_in(const SortedFloatJson& json) {
    SceneLooks looks;
    looks.config.model = json.at("model").get<std::string>();
    if (json.value("vignetting", false))
      refuse("its run learned the vignetting of cameras, which is no longer learned");
    const auto model = model_of(looks.config);
    photo_names_ = model->photo_names();
    take_photos(json.at("photos"), false, looks);
    take_photos(json.at("held_out"), true, looks);
    looks.rule = json.at("rule").get<std::string>();
    for (const auto& [name, spread] : json.at("spreads").items())
      looks.rules.push_back({name, double(spread.get<float>())});
    return looks;
  }

  std::unique_ptr<PhotometricModel> model_of(const PhotometricConfig& config) const {
    const Names known = photometric_models();
    const bool is_known = std::find(known.begin(), known.end(), config.model) != known.end();
    const bool is_chosen = is_known && config.model != kAutoPhotometricModel;
    auto model = is_chosen ? make_photometric_model(config) : nullptr;
    if (!model)
      refuse(fmt::format("there is no photometric.model '{}' here", shown_word(config.model)));
    return model;
  }

  void take_photos(const SortedFloatJson& photos, bool is_held_out, SceneLooks& looks) const {
    for (const auto& [name, photo] : photos.items())
      looks.photos[name] = {std::uint32_t(whole(photo, "camera", UINT32_MAX)), is_held_out,
                            numbers(photo_names_, name, photo)};
  }

  std::uint64_t whole(const SortedFloatJson& json, const char* key, std::uint64_t most) const {
    const SortedFloatJson& value = json.at(key);
    if (!value.is_number_unsigned() || value.get<std::uint64_t>() > most)
      refuse(fmt::format("{} is no whole number from 0 to {}", key, most));
    return value.get<std::uint64_t>();
  }

  std::vector<float> numbers(const Names& names, const std::string& of,
                             const SortedFloatJson& json) const {
    std::vector<float> values;
    for (const std::string& name : names) {
      values.push_back(json.at(name).get<float>());
      if (!std::isfinite(values.back()))
        refuse(fmt::format("{} of '{}' is not finite", name, shown_word(of)));
    }
    return values;
  }

  [[noreturn]] void refuse(const std::string& what) const {
    cannot_read(path_, fmt::format("{}; {}", what, kRemedyOfLooks));
  }

  std::filesystem::path path_;
  Names photo_names_;
};

}  // namespace

void write_photometric(const std::filesystem::path& path, const SceneLooks& looks) {
  const auto model = make_photometric_model(looks.config);
  SortedFloatJson json = {{"model", looks.config.model}};
  json["photos"] = photos_json(looks, model->photo_names(), false);
  json["held_out"] = photos_json(looks, model->photo_names(), true);
  json["rule"] = looks.rule;
  json["spreads"] = SortedFloatJson::object();
  for (const HeldOutRule& rule : looks.rules) json["spreads"][rule.name] = float(rule.spread);
  AtomicFile file(path);
  file.write(json.dump(1, ' ', false, SortedFloatJson::error_handler_t::replace) + "\n");
  file.commit();
}

SceneLooks read_photometric(const std::filesystem::path& path) { return Reader(path).looks(); }

}  // namespace gs
