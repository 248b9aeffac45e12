// SPDX-License-Identifier: Apache-2.0
#include "gs_app/report/report_views.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>

#include "data_loaders/photos/photos.h"
#include "gs_app/pictures/comparison.h"
#include "gs_app/pictures/pictures.h"
#include "gs_app/report/report_page.h"
#include "gs_app/run/page_text.h"
#include "gs_app/run/results.h"
#include "gs_core/error.h"
#include "gs_core/system/text/json.h"
#include "gs_core/system/text/read_json.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kMostViews = 24;
constexpr std::size_t kMostBytes = 12 << 20;  // of all pictures, in base64
constexpr int kLongestSide = 800;             // pixels
constexpr int kQuality = 88;                  // of JPEG: blocks are hardly visible

Image8 at_most(const Image8& image, int longest) {
  const double scale = std::min(1.0, double(longest) / std::max(image.width, image.height));
  return area_resized(image, std::max(1, int(std::lround(image.width * scale))),
                      std::max(1, int(std::lround(image.height * scale))));
}

std::string data_uri(const Image8& image) {
  return "data:image/jpeg;base64," + base64_of(encode_jpeg(image, kQuality));
}

// Adds photo, render, error and FLIP of one picture to `view`. Returns their bytes.
std::size_t add_pictures(const fs::path& pictures, const std::string& file, Json& view) {
  const Image8 photo = read_photo(pictures / "gt" / file);
  const Image8 render = read_photo(pictures / "renders" / file);
  if (photo.width != render.width || photo.height != render.height)
    throw Error((pictures / "renders" / file).string() +
                " has another size than its photo; move the folder " + pictures.string() +
                " away for a report without pictures");
  const Image8 small = at_most(render, kLongestSide), small_photo = at_most(photo, kLongestSide);
  view["width"] = small.width;
  view["height"] = small.height;
  view["photo"] = data_uri(small_photo);
  view["render"] = data_uri(small);
  view["error"] = data_uri(at_most(error_picture(photo, render), kLongestSide));
  view["flip_picture"] = data_uri(flip_picture(small_photo, small));  // as the page shows both
  std::size_t bytes = 0;
  for (const char* key : {"photo", "render", "error", "flip_picture"})
    bytes += view[key].get_ref<const std::string&>().size();
  return bytes;
}

// The names of the views, in the order of their pictures.
std::vector<std::string> names_of(const RunFolder& folder, const std::string& split) {
  const std::vector<std::string> all = split_names(folder, split);
  if (split == "test") return all;
  std::vector<std::string> sample;
  for (const std::size_t index : evenly_chosen(all.size(), kTrainViewsShown))
    sample.push_back(all[index]);
  return sample;
}

}  // namespace

Json report_views(const RunFolder& folder, int step, std::vector<std::string>& notes) {
  if (!fs::exists(folder.split()) || !fs::exists(folder.per_view())) return nullptr;
  const std::string split = split_names(folder, "test").empty() ? "train" : "test";
  const std::vector<std::string> names = names_of(folder, split);
  const Json per_view = read_json(folder.per_view());
  const fs::path pictures = folder.pictures(split, step);
  Json list = Json::array();
  for (const std::string& name : names) {
    Json view = {{"name", name}};
    take_from_json(folder.per_view(), "evaluate the run again with `gemsplat eval`", [&] {
      if (per_view.contains(split) && per_view.at(split).contains(name))
        view.update(per_view.at(split).at(name));
    });
    list.push_back(std::move(view));
  }
  std::size_t bytes = 0, missing = 0;
  for (const std::size_t index : evenly_chosen(names.size(), kMostViews)) {
    const std::string file = picture_file(index);
    if (!fs::exists(pictures / "gt" / file) || !fs::exists(pictures / "renders" / file)) {
      ++missing;
    } else if (bytes < kMostBytes) {
      bytes += add_pictures(pictures, file, list[index]);
    }
  }
  if (missing)
    notes.push_back(fmt::format("{} views have no pictures in {}", missing, pictures.string()));
  return {{"split", split}, {"total", names.size()}, {"list", std::move(list)}};
}

}  // namespace gs
