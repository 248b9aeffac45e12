// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/scene/scene_hash.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <map>
#include <string_view>
#include <vector>

#include "data_loaders/photos/photo_names.h"
#include "data_loaders/scene/find_scene.h"
#include "data_loaders/scene/photo_times.h"
#include "data_loaders/scene/place_scene.h"
#include "data_loaders/video/film_frames.h"
#include "gs_core/system/files/access.h"
#include "gs_core/system/fnv1a.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

// The hash of a part would be that of another scene.
[[noreturn]] void fail(const fs::path& file) {
  cannot_access(file, std::string(std::strerror(errno)) + "; check its permissions and the disk");
}

void add_file(Fnv1a& hash, const fs::path& file) {
  std::error_code ignored;
  if (!fs::is_regular_file(file, ignored)) return;  // to open a FIFO would wait for its writer
  std::ifstream stream(file, std::ios::binary);
  std::array<char, 1 << 16> block;
  while (stream.read(block.data(), block.size()), stream.gcount() > 0)
    hash.add({block.data(), std::size_t(stream.gcount())});
  if (!stream.eof()) fail(file);
}

bool belongs_to_model(const fs::path& file) {
  const std::string stem = file.stem().string(), ending = lowercase_ending(file);
  if (ending == ".json") return stem.starts_with("transforms");
  return (ending == ".bin" || ending == ".txt") &&
         (stem == "cameras" || stem == "images" || stem == "points3D" || stem == "rigs" ||
          stem == "frames");
}

std::vector<fs::path> model_files(const SceneFolders& folders) {
  if (folders.kind == SceneKind::foreign) {  // the file, or one of those for each photo
    std::vector<fs::path> files = entries_of(folders.model.parent_path());
    std::erase_if(
        files, [&](const fs::path& file) { return file.extension() != folders.model.extension(); });
    return files;
  }
  std::vector<fs::path> files = entries_of(folders.model);
  std::erase_if(files, [](const fs::path& file) { return !belongs_to_model(file); });
  return files;
}

std::vector<std::string> video_names_in(const fs::path& folder) {
  std::vector<std::string> names;
  for (const fs::path& file : entries_of(folder))
    if (is_video(file)) names.push_back(file.filename().string());
  std::sort(names.begin(), names.end());
  return names;
}

constexpr std::uint64_t kSampleBytes = 1 << 14;

std::uint64_t photo_hash(const fs::path& file) {
  std::error_code error;
  const std::uint64_t bytes = fs::file_size(file, error);  // an error for what is no regular file
  if (error) return 0;
  std::ifstream stream(file, std::ios::binary);
  if (!stream) fail(file);
  Fnv1a hash;
  hash.add(fmt::format("{}\n", bytes));
  std::vector<char> sample(std::min(bytes, kSampleBytes));
  const std::uint64_t last = bytes - sample.size();
  for (const std::uint64_t start : {std::uint64_t(0), last / 2, last}) {
    stream.seekg(std::streamoff(start));
    if (!stream.read(sample.data(), std::streamsize(sample.size()))) fail(file);
    hash.add({sample.data(), sample.size()});
  }
  return std::max<std::uint64_t>(hash.value(), 1);
}

}  // namespace

std::vector<std::uint64_t> photo_hashes(const DatasetConfig& dataset,
                                        const std::vector<std::string>& names) {
  const fs::path folder = find_scene(dataset).images;
  std::map<std::string, std::uint64_t> of_cameras;  // that have videos
  std::vector<std::uint64_t> hashes;
  for (const fs::path& file : match_photos(names, folder)) {
    const std::string camera = fs::path(names[hashes.size()]).parent_path().generic_string();
    if (!file.empty() || dataset.times != PhotoTimes::frames) {
      hashes.push_back(photo_hash(file));
      continue;
    }
    const auto [known, is_new] = of_cameras.try_emplace(camera);
    if (is_new) known->second = photo_hash(video_of_camera(folder, camera));
    hashes.push_back(known->second);
  }
  return hashes;
}

std::string scene_hash(const DatasetConfig& dataset) {
  const SceneFolders folders = find_scene(dataset);
  Fnv1a hash;
  std::vector<std::string> names = picture_names_in(folders.images);
  if (dataset.times == PhotoTimes::frames) {
    const std::vector<std::string> videos = video_names_in(folders.images);
    names.insert(names.end(), videos.begin(), videos.end());
  }
  for (const std::string& name : names) {
    std::error_code ignored;
    hash.add(fmt::format("{}\n{}\n", name, fs::file_size(folders.images / name, ignored)));
  }
  for (const fs::path& file : model_files(folders)) {
    hash.add(file.filename().string() + "\n");
    add_file(hash, file);
  }
  return fmt::format("{:016x}", hash.value());
}

}  // namespace gs
