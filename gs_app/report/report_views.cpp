// SPDX-License-Identifier: Apache-2.0
#include "gs_app/report/report_views.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>

#include "data_loaders/photos/encode/encode_jpeg.h"
#include "data_loaders/photos/photos.h"
#include "gs_app/pictures/pictures.h"
#include "gs_app/report/report_page.h"
#include "gs_app/run/page_text.h"
#include "gs_app/run/results.h"
#include "gs_core/error.h"
#include "gs_core/system/text/json.h"
#include "gs_core/system/text/read_json.h"
#include "gs_core/threads/parallel.h"

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

Comparison read_pictures(const fs::path& pictures, const std::string& file) {
  Comparison view{read_photo(pictures / "gt" / file), read_photo(pictures / "renders" / file)};
  if (view.photo.width != view.render.width || view.photo.height != view.render.height)
    throw Error((pictures / "renders" / file).string() +
                " has another size than its photo; move the folder " + pictures.string() +
                " away for a report without pictures");
  return view;
}

// What the page shows of a view.
struct PagePictures {
  int width = 0, height = 0;
  std::string photo, render, error, flip;  // data URIs

  std::size_t bytes() const { return photo.size() + render.size() + error.size() + flip.size(); }
};

PagePictures page_pictures(const Comparison& view) {
  const Image8 photo = at_most(view.photo, kLongestSide),
               render = at_most(view.render, kLongestSide);
  return {render.width,
          render.height,
          data_uri(photo),
          data_uri(render),
          data_uri(at_most(error_picture(view.photo, view.render), kLongestSide)),
          data_uri(flip_picture(photo, render))};  // as the page shows both
}

}  // namespace

std::string page_picture(const Image8& image) { return data_uri(at_most(image, kLongestSide)); }

std::vector<std::string> names_of_pictures(const RunFolder& folder, const std::string& split) {
  const std::vector<std::string> all = split_names(folder, split);
  if (split == "test") return all;
  std::vector<std::string> sample;
  for (const std::size_t index : evenly_chosen(all.size(), kTrainViewsShown))
    sample.push_back(all[index]);
  return sample;
}

std::vector<std::size_t> shown_in_report(std::size_t count) {
  return evenly_chosen(count, kMostViews);
}

Json report_views(const RunFolder& folder, int step, const ShownViews& known,
                  std::vector<std::string>& notes) {
  if (!fs::exists(folder.split()) || !fs::exists(folder.per_view())) return nullptr;
  const std::string split = split_names(folder, "test").empty() ? "train" : "test";
  const std::vector<std::string> names = names_of_pictures(folder, split);
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
  std::size_t missing = 0;
  std::vector<std::size_t> shown;
  for (const std::size_t index : shown_in_report(names.size())) {
    const std::string file = picture_file(index);
    if (known.contains(index) ||
        (fs::exists(pictures / "gt" / file) && fs::exists(pictures / "renders" / file)))
      shown.push_back(index);
    else
      ++missing;
  }
  std::vector<PagePictures> made(shown.size());
  parallel_for(shown.size(), 1, [&](std::size_t i) {
    const auto view = known.find(shown[i]);
    made[i] = page_pictures(view != known.end() ? view->second
                                                : read_pictures(pictures, picture_file(shown[i])));
  });
  std::size_t bytes = 0;
  for (std::size_t i = 0; i < made.size() && bytes < kMostBytes; bytes += made[i++].bytes())
    list[shown[i]].update({{"width", made[i].width},
                           {"height", made[i].height},
                           {"photo", made[i].photo},
                           {"render", made[i].render},
                           {"error", made[i].error},
                           {"flip_picture", made[i].flip}});
  if (missing)
    notes.push_back(fmt::format("{} views have no pictures in {}", missing, pictures.string()));
  return {{"split", split}, {"total", names.size()}, {"list", std::move(list)}};
}

}  // namespace gs
