// SPDX-License-Identifier: Apache-2.0
#include "gs_app/view/served_model.h"

#include <algorithm>
#include <cstring>

#include "gs_app/run/text.h"
#include "gs_core/system/byte_reader.h"
#include "gs_core/system/log.h"
#include "gs_core/system/text/json.h"
#include "gs_model/edit/model_transform.h"
#include "gs_model/formats/ply/compressed_ply.h"
#include "gs_model/formats/ply/mip_filter.h"
#include "gs_model/formats/ply/ply.h"
#include "gs_model/formats/ply/ply_file.h"

namespace gs {
namespace {

bool is_plain(const PlyHeader& header) {
  if (header.format != PlyFormat::little_endian || header.elements.empty()) return false;
  if (is_compressed_ply(header)) return true;
  if (has_filter_3d(header)) return false;  // browsers would ignore it
  const PlyElement& vertex = header.elements.front();
  const auto has_time = [](const PlyProperty& property) { return property.name == "time_mean"; };
  if (std::any_of(vertex.properties.begin(), vertex.properties.end(), has_time)) return false;
  return vertex.name == "vertex" && std::all_of(vertex.properties.begin(), vertex.properties.end(),
                                                [](const PlyProperty& property) {
                                                  return property.type == PlyType::float32 &&
                                                         !property.count_type;
                                                });
}

// Version 4 begins with a magic number; older versions are gzip streams.
bool is_newer_spz(const std::filesystem::path& file) {
  ByteReader reader(file);
  return reader.size() >= 4 && std::memcmp(reader.peek(4), "NGSP", 4) == 0;
}

// The format by the file's name. A .ply may be a compressed PLY, which only its header tells.
const ModelFormat& format_of(const std::filesystem::path& file) {
  const ModelFormat* const format = find_format(file);
  if (format && format->name != "ply") return *format;
  return format_named(is_compressed_ply(PlyFile(file).header()) ? "compressed.ply" : "ply");
}

// Puts a file that was made of the model in the place of its own.
void make_file(ServedModel& model, const OpenedModel& opened, const char* format) {
  model.scratch = std::make_shared<ScratchFolder>();
  model.format = &format_named(format);
  model.file = model.scratch->path() / ("model" + std::string(model.format->ending));
  model.gaussians = write_model(model.file, opened.model);
}

}  // namespace

bool is_served_as_it_is(const std::filesystem::path& file) {
  const std::string_view name = format_of(file).name;
  if (name == "ply" || name == "compressed.ply") return is_plain(PlyFile(file).header());
  if (name == "spz") return !is_newer_spz(file);
  return name == "sog" || name == "splat" || name == "gs4d" || name == "rad";
}

ServedModel serve_model(const OpenedModel& opened, std::size_t stream_from) {
  ServedModel model;
  model.file = opened.ply;
  model.format = &format_of(model.file);
  model.name = model.file.filename().string();
  model.gaussians = opened.model.gaussians.count();
  model.sh_degree = opened.model.sh_degree;
  model.antialiased = opened.model.antialiased;
  const bool has_time = opened.model.gaussians.has_time;
  const bool is_large = stream_from > 0 && model.gaussians >= stream_from;
  if (is_large && !has_time && model.format->name != "rad") {
    log_info(
        "{} has {} Gaussians: making levels of detail, which the page streams; `gemsplat export "
        "MODEL FILE.rad` keeps them, and --stream-from 0 sends the whole model",
        model.name, with_commas(model.gaussians));
    make_file(model, opened, "rad");
  } else if (!is_served_as_it_is(model.file)) {
    make_file(model, opened, has_time ? "gs4d" : "ply");
    if (!has_time)
      log_info("the viewer's page cannot read {}: made a PLY from it", opened.ply.string());
  }
  return model;
}

Json model_json(const ServedModel& model) {
  return model_json(*model.format, model.name, model.gaussians,
                    std::filesystem::file_size(model.file), model.sh_degree, model.antialiased);
}

Json model_json(const ModelFormat& format, const std::string& name, std::size_t gaussians,
                std::uint64_t bytes, int sh_degree, bool antialiased) {
  Json matrix = Json::array();
  for (const auto& row : diagonal(format.signs).m)
    for (const double number : row) matrix.push_back(number);
  return {{"format", format.name},    {"gaussians", gaussians},     {"bytes", bytes},
          {"sh_degree", sh_degree},   {"antialiased", antialiased}, {"name", name},
          {"world_from_file", matrix}};
}

}  // namespace gs
