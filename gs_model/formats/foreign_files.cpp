// SPDX-License-Identifier: Apache-2.0
#include "gs_model/formats/foreign_files.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cctype>
#include <fstream>
#include <string_view>

#include "gs_core/system/text/ascii.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

constexpr std::string_view kConvert = "convert it to .ply with SuperSplat or splat-transform";

/// A kind of file, told by the end of its name or by its first bytes.
struct Foreign {
  std::string_view mark, kind, remedy;
};

constexpr Foreign kEndings[] = {
    {".csv", "a table", "give the columns that numpy.loadtxt reads to gemsplat.Model"},
    {".lcc", "an .lcc scene of XGRIDS", kConvert},
    {"lod-meta.json", "a streamed SOG",
     "name a meta.json of its folders, or the model.rad beside it"},
    {".ksplat", "a .ksplat file of GaussianSplats3D", kConvert},
    {".splatv", "a .splatv file of moving Gaussians", "train one moment and name its .ply"},
    {".pth", "a checkpoint of a PyTorch trainer", "let that trainer export a .ply"},
    {".pt", "a checkpoint of a PyTorch trainer", "let that trainer export a .ply"},
    {".ckpt", "a checkpoint of a PyTorch trainer", "let that trainer export a .ply"},
    {".html", "a web page", "name the model that the page shows"}};

constexpr Foreign kFirstBytes[] = {
    {"NGSP", "an .spz file of version 4", "give it a name that ends in .spz"},
    {"\x1f\x8b", "a gzip file, as .spz files are", "give it a name that ends in .spz"},
    {"PK\x03\x04", "a zip file, as .sog and .npz files are",
     "give it a name that ends in .sog or .npz"},
    {"#usd", "a layer of OpenUSD", "give it a name that ends in .usda"},
    {"PXR-", "a layer of OpenUSD", "give it a name that ends in .usdc"},
    {"RAD0", "a .rad file", "give it a name that ends in .rad"},
    {"glTF", "a .glb file", "give it a name that ends in .glb"}};

std::string text_of(const Foreign& foreign) {
  return fmt::format("this is {}, not a PLY; {}", foreign.kind, foreign.remedy);
}

}  // namespace

std::string foreign_kind(const fs::path& path) {
  std::error_code ignored;
  if (!fs::is_regular_file(path, ignored)) return "";  // to open a FIFO would wait for its writer
  std::ifstream file(path, std::ios::binary);
  char first[4] = {};
  if (!file) return "";
  file.read(first, sizeof first);
  const std::string_view beginning(first, std::size_t(file.gcount()));
  if (beginning.starts_with("ply")) return "";
  const std::string name = lowercase(path.filename().string());
  for (const Foreign& foreign : kEndings)
    if (name.ends_with(foreign.mark)) return text_of(foreign);
  for (const Foreign& foreign : kFirstBytes)
    if (beginning.starts_with(foreign.mark)) return text_of(foreign);
  return "";
}

}  // namespace gs
