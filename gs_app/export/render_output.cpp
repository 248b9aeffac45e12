// SPDX-License-Identifier: Apache-2.0
#include "gs_app/export/render_output.h"

#include <spdlog/fmt/fmt.h>

#include <set>
#include <utility>

#include "data_loaders/photos/encode/encode_png.h"
#include "data_loaders/photos/exr.h"
#include "data_loaders/photos/panorama.h"
#include "data_loaders/photos/photo_names.h"
#include "gs_app/export/export_model.h"
#include "gs_app/pictures/pictures.h"
#include "gs_core/error.h"
#include "gs_core/system/files/move_aside.h"
#include "gs_core/system/log.h"
#include "gs_core/threads/parallel.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kMostWaitingBytes = std::size_t(1) << 29;
constexpr const char* kOtherFilms[] = {".mov", ".mkv", ".avi", ".webm", ".m4v", ".gif", ".mpg"};
constexpr const char* kPictures[] = {".png", ".jpg", ".jpeg", ".exr"};

}  // namespace

bool OutputRequest::is_film() const { return lowercase_ending(output) == ".mp4"; }

bool OutputRequest::is_color_in_8_bits() const {
  return !exr && quantities == std::vector<Quantity>{Quantity::color};
}

void check_output(const OutputRequest& request) {
  const std::string ending = lowercase_ending(request.output);
  for (const char* other : kOtherFilms)
    if (ending == other)
      throw UsageError(fmt::format(
          "-o {}: films are written as .mp4; name a file with this ending, which ffmpeg "
          "turns into others (ffmpeg -i film.mp4 film{}), or a folder for pictures",
          request.output.string(), ending));
  for (const char* picture : kPictures)
    if (ending == picture && !fs::is_directory(request.output))
      throw UsageError(
          fmt::format("-o {}: pictures go into a folder, each with the name of its view; name a "
                      "folder, or a film that ends in .mp4",
                      request.output.string()));
  if (request.is_film() && request.exr)
    throw UsageError(
        "a film has 8 bits; EXR files go into a folder: name one with -o, or leave --format out");
  if (request.is_film() && !can_write_films())
    throw Error(
        fmt::format("cannot write the film {}: {}", request.output.string(), cannot_write_films()));
  if (request.exr && !can_write_exr())
    throw Error(fmt::format("cannot write EXR files: {}", cannot_write_exr()));
  if (!request.is_film() && fs::exists(request.output) && !fs::is_directory(request.output))
    throw UsageError(request.output.string() +
                     " is a file; name a folder, or a film that ends "
                     "in .mp4");
}

RenderOutput::RenderOutput(OutputRequest request, std::vector<std::string> names,
                           const DepthRange& range)
    : request_(std::move(request)),
      lock_(request_.is_film() ? OutputLock::of_file(request_.output)
                               : OutputLock::of_folder(request_.output)),
      names_(std::move(names)), range_(range) {
  std::set<fs::path> files;
  const auto take = [&](const fs::path& file, const std::string& view) {
    check_place(file, request_.force);
    if (!files.insert(file).second)
      throw UsageError(
          fmt::format("two views would be written to {}, one of them {}; give them different names",
                      file.string(), view));
  };
  for (const Quantity quantity : request_.quantities) {
    if (request_.is_film()) {
      take(film(quantity), "");
      continue;
    }
    for (std::size_t i = 0; i < names_.size(); ++i)
      for (const char* extension : extensions()) take(picture(i, quantity, extension), names_[i]);
  }
}

std::vector<const char*> RenderOutput::extensions() const {
  std::vector<const char*> result;
  if (request_.png) result.push_back(".png");
  if (request_.exr) result.push_back(".exr");
  return result;
}

// A quantity that is alone has the plain name.
std::string RenderOutput::suffix(Quantity quantity) const {
  const bool is_plain = quantity == Quantity::color || request_.quantities.size() == 1;
  return is_plain ? "" : "." + name_of(quantity);
}

fs::path RenderOutput::film(Quantity quantity) const {
  fs::path file = request_.output;
  const std::string extension = file.extension().string();
  return file.replace_extension() += suffix(quantity) + extension;
}

fs::path RenderOutput::picture(std::size_t i, Quantity quantity, const char* extension) const {
  fs::path file = picture_path(request_.output, names_[i]);
  return file.replace_extension() += suffix(quantity) + extension;
}

fs::path RenderOutput::description() const {
  if (!request_.is_film()) return request_.output / "film.json";
  return fs::path(request_.output).replace_extension(".json");
}

fs::path RenderOutput::cameras() const {
  if (!request_.is_film()) return request_.output / "cameras.json";
  return fs::path(request_.output).replace_extension(".cameras.json");
}

std::map<std::string, std::vector<std::string>> RenderOutput::patterns() const {
  std::map<std::string, std::vector<std::string>> result;
  for (const Quantity quantity : request_.quantities) {
    std::vector<std::string>& files = result[name_of(quantity)];
    if (request_.is_film()) {
      files.push_back(film(quantity).filename().string());
    } else {
      for (const char* extension : extensions())
        files.push_back("{name}" + suffix(quantity) + extension);
    }
  }
  return result;
}

void RenderOutput::move_older_aside(const fs::path& file) {
  if (!fs::exists(file)) return;
  keep_aside(file);
  ++moved_aside_;
}

void RenderOutput::write_frame(Quantity quantity, const Image8& frame) {
  auto writer = films_.find(quantity);
  if (writer == films_.end())
    writer = films_
                 .emplace(quantity, FilmWriter(film(quantity), frame.width, frame.height,
                                               request_.frames_per_second))
                 .first;
  writer->second.write(frame);
  codec_ = writer->second.codec();
}

void RenderOutput::write(std::size_t i, Quantity quantity, Image8 shown) {
  if (request_.is_film()) return write_frame(quantity, shown);
  const std::size_t bytes = shown.pixels.size();
  add(picture(i, quantity, ".png"), bytes,
      [shown = std::move(shown), is_panorama = request_.is_panorama](const fs::path& file) {
        write_png(file, shown, is_panorama ? panorama_xmp(shown.width, shown.height) : "");
      });
}

void RenderOutput::write(std::size_t i, Quantity quantity, const ImageF& values) {
  if (request_.is_film() || request_.png) write(i, quantity, picture_of(quantity, values, range_));
  if (request_.exr)
    add(picture(i, quantity, ".exr"), values.pixels.size() * sizeof(float),
        [values, channels = channels_of(quantity)](const fs::path& file) {
          write_exr(file, values, channels);
        });
}

void RenderOutput::add(fs::path file, std::size_t bytes,
                       std::function<void(const fs::path&)> write) {
  waiting_.push_back({std::move(file), std::move(write)});
  waiting_bytes_ += bytes;
  if (waiting_.size() >= 2 * std::size_t(thread_count()) || waiting_bytes_ >= kMostWaitingBytes)
    write_waiting();
}

void RenderOutput::write_waiting() {
  const std::vector<Waiting> files = std::exchange(waiting_, {});
  waiting_bytes_ = 0;
  parallel_for(files.size(), 1, [&](std::size_t i) {
    move_older_aside(files[i].file);
    files[i].write(files[i].file);
  });
}

void RenderOutput::finish() {
  write_waiting();
  for (auto& [quantity, writer] : films_) {
    move_older_aside(film(quantity));
    writer.commit(request_.is_panorama);
  }
  if (const std::size_t count = moved_aside_)
    log_info("{} older files are now called FILE.bak-N", count);
}

}  // namespace gs
