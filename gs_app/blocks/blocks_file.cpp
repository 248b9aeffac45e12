// SPDX-License-Identifier: Apache-2.0
#include "gs_app/blocks/blocks_file.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>
#include <set>

#include "gs_core/config/text/region_text.h"
#include "gs_core/error.h"
#include "gs_core/system/text/foreign_text.h"
#include "gs_core/system/text/json.h"
#include "gs_core/system/text/read_json.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

constexpr double kSameNormal = 1e-9;  // difference of unit vectors that are the same
constexpr const char* kBlocksFile = "blocks.json";
constexpr const char* kRemedyOfBlocks = "write it again with `gemsplat partition`";

Json json_of(const Vec3d& v) { return {v.x, v.y, v.z}; }
Json json_of(const CutSide& side) { return {{side.is_cut ? "cut" : "block", side.index}}; }

Json json_of(const Cut& cut) {
  return {{"normal", json_of(cut.normal)},
          {"offset", cut.offset},
          {"below", json_of(cut.below)},
          {"above", json_of(cut.above)}};
}

Json json_of(const BlockEntry& block) {
  return {{"name", block.name},
          {"config", block.config},
          {"run", block.run},
          {"region", block.region},
          {"train_photos", block.train_photos},
          {"test_photos", block.test_photos},
          {"points", block.points},
          {"points_outside", block.points_outside}};
}

Vec3d vector_of(const Json& json) {
  return {json.at(0).get<double>(), json.at(1).get<double>(), json.at(2).get<double>()};
}

CutSide side_of(const Json& json) {
  const bool is_cut = json.contains("cut");
  return {is_cut, whole_number<std::size_t>(json.at(is_cut ? "cut" : "block"))};
}

Cut cut_of(const Json& json) {
  return {vector_of(json.at("normal")), json.at("offset").get<double>(), side_of(json.at("below")),
          side_of(json.at("above"))};
}

BlockEntry block_of(const Json& json) {
  BlockEntry block;
  block.name = json.at("name").get<std::string>();
  block.config = json.at("config").get<std::string>();
  block.run = json.at("run").get<std::string>();
  block.region = json.at("region").get<std::string>();
  block.train_photos = whole_number<std::size_t>(json.at("train_photos"));
  block.test_photos = whole_number<std::size_t>(json.at("test_photos"));
  block.points = whole_number<std::size_t>(json.at("points"));
  block.points_outside = whole_number<std::size_t>(json.at("points_outside"));
  return block;
}

// Whether a block's region holds the whole part of space that the block owns.
bool covers(const std::string& region, const std::vector<WideHalfSpace>& part) {
  const auto half_spaces = parse_region(region);
  return half_spaces && std::ranges::all_of(*half_spaces, [&](const WideHalfSpace& half) {
           return std::ranges::any_of(part, [&](const WideHalfSpace& bound) {
             const Vec3d turn = half.normal - bound.normal;
             return inner(turn, turn) < kSameNormal * kSameNormal && half.offset <= bound.offset;
           });
         });
}

// Each block is in the file once, and at the place of its part: else Gaussians would be lost.
void check_entries(const BlocksFile& blocks) {
  std::set<std::string> names, runs;
  for (std::size_t b = 0; b < blocks.blocks.size(); ++b) {
    const BlockEntry& block = blocks.blocks[b];
    const auto refuse = [&](const std::string& why) {
      throw Error(fmt::format("cannot use {}: {}; {}", blocks.file.string(), why, kRemedyOfBlocks));
    };
    if (!names.insert(block.name).second) refuse("it names " + shown_word(block.name) + " twice");
    if (!runs.insert(fs::path(block.run).lexically_normal().string()).second)
      refuse(shown_word(block.name) + " has the run of another block");
    if (!covers(block.region, blocks.tree.bounds_of(b)))
      refuse("the region of " + shown_word(block.name) + " does not hold what the block owns");
  }
}

void check(const BlocksFile& blocks) {
  bool is_sound = blocks.tree.is_whole() && blocks.tree.parts() == blocks.blocks.size();
  for (const Cut& cut : blocks.tree.cuts)
    is_sound &= std::isfinite(cut.offset) && inner(cut.normal, cut.normal) > 0;
  if (!is_sound)
    throw Error(fmt::format("cannot use {}: its cuts do not divide space into its {} blocks; {}",
                            blocks.file.string(), blocks.blocks.size(), kRemedyOfBlocks));
  check_entries(blocks);
}

}  // namespace

std::string blocks_json(const BlocksFile& blocks) {
  Json json = {{"scene", blocks.scene},
               {"up", json_of(blocks.up)},
               {"cuts", Json::array()},
               {"blocks", Json::array()}};
  for (const Cut& cut : blocks.tree.cuts) json["cuts"].push_back(json_of(cut));
  for (const BlockEntry& block : blocks.blocks) json["blocks"].push_back(json_of(block));
  return file_text(json);
}

bool is_partition(const fs::path& file_or_folder) {
  std::error_code ignored;
  return file_or_folder.filename() == kBlocksFile ||
         fs::exists(file_or_folder / kBlocksFile, ignored);
}

BlocksFile read_blocks(const fs::path& file_or_folder) {
  std::error_code ignored;
  BlocksFile blocks;
  blocks.file =
      fs::is_directory(file_or_folder, ignored) ? file_or_folder / kBlocksFile : file_or_folder;
  if (!fs::exists(blocks.file, ignored))
    throw Error("there is no partition at " + file_or_folder.string() +
                "; name the folder that `gemsplat partition` has written, or its blocks.json");
  const Json json = read_json_as(blocks.file, kRemedyOfBlocks);
  take_from_json(blocks.file, kRemedyOfBlocks, [&] {
    blocks.scene = json.at("scene").get<std::string>();
    blocks.up = vector_of(json.at("up"));
    for (const Json& cut : json.at("cuts")) blocks.tree.cuts.push_back(cut_of(cut));
    for (const Json& block : json.at("blocks")) blocks.blocks.push_back(block_of(block));
  });
  check(blocks);
  return blocks;
}

}  // namespace gs
