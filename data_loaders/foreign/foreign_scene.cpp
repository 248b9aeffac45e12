// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/foreign/foreign_scene.h"

#include <algorithm>
#include <string_view>
#include <vector>

#include "data_loaders/foreign/foreign_model.h"
#include "gs_core/error.h"
#include "gs_core/system/byte_reader.h"
#include "gs_core/system/files/access.h"
#include "gs_core/system/log.h"
#include "gs_core/system/text/ascii.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

struct Form {
  const char* folder;    // that the file lies in; empty: any
  const char* name_end;  // of its name, in lower case
  const char* content;   // among its first bytes, in lower case
  const char* program;
  void (*read)(ForeignModel&);
};

constexpr Form kForms[] = {
    {"", ".xml", "<document", "Metashape", read_metashape},
    {"", ".csv", "#name,x,y", "RealityScan", read_realityscan},
    {"", "reconstruction.json", "\"cameras\"", "OpenSfM", read_opensfm},
    {"", ".json", "\"sfm_data_version\"", "OpenMVG", read_openmvg},
    {"", ".sfm", "\"views\"", "Meshroom", read_alicevision},
    {"", ".json", "\"featuresfolders\"", "Meshroom", read_alicevision},
    {"", "bundle.out", "# bundle file v0.3", "Bundler", read_bundler},
    {"", ".out", "# bundle file v0.3", "Bundler", read_bundler},
    {"corrected_cameras", ".json", "\"t_00\"", "Polycam", read_polycam},
    {"cameras", ".json", "\"t_00\"", "Polycam", read_polycam},
    {"", "metadata.json", "\"k\":", "Record3D", read_record3d},
    {"", "metadata.json", "\"frametimestamps\":", "Record3D", read_record3d},
    {"", "metadata.json", "\"poses\":[[", "Record3D", read_record3d},
    {"", "metadata", "\"k\":", "Record3D", read_record3d},
    {"", "metadata", "\"frametimestamps\":", "Record3D", read_record3d},
    {"", "metadata", "\"poses\":[[", "Record3D", read_record3d},
    {"cams", "_cam.txt", "extrinsic", "MVSNet", read_mvsnet},
};

constexpr int kDeepest = 3;                   // folders below the scene's
constexpr std::size_t kMostEntries = 200000;  // of folders that are looked through
constexpr std::uint64_t kHead = 4096;         // bytes

bool may_be(const Form& form, const fs::path& file) {
  return lowercase(file.filename().string()).ends_with(form.name_end) &&
         (!*form.folder || file.parent_path().filename() == form.folder);
}

/// `head`: beginning_of() the file.
bool is_of(const Form& form, const fs::path& file, const std::string& head) {
  return may_be(form, file) && head.find(form.content) != head.npos &&
         (form.read != read_bundler || bundler_list(file));
}

/// The files that may be of a form, sorted by depth and name.
void collect(const fs::path& folder, int depth, std::size_t& entries,
             std::vector<fs::path>& files) {
  std::error_code error;
  std::vector<fs::path> below;
  for (fs::directory_iterator entry(folder, error), end; !error && entry != end;
       entry.increment(error)) {
    if (++entries > kMostEntries) break;
    const fs::path& path = entry->path();
    if (path.filename().string().starts_with('.')) continue;
    if (entry->is_directory(error))
      below.push_back(path);
    else if (std::any_of(std::begin(kForms), std::end(kForms),
                         [&](const Form& form) { return may_be(form, path); }))
      files.push_back(path);
  }
  std::sort(below.begin(), below.end());
  if (depth < kDeepest)
    for (const fs::path& next : below) collect(next, depth + 1, entries, files);
}

const Form* form_of(const fs::path& file) {
  const std::string head = beginning_of(file);
  for (const Form& form : kForms)
    if (is_of(form, file, head)) return &form;
  return nullptr;
}

}  // namespace

std::string beginning_of(const fs::path& file) {
  try {
    ByteReader reader(file);
    const auto bytes = std::size_t(std::min(reader.size(), kHead));
    return lowercase({reinterpret_cast<const char*>(reader.peek(bytes)), bytes});
  } catch (const Error&) {  // a file that cannot be read is nobody's poses
    return "";
  }
}

std::optional<ForeignScene> find_foreign_scene(const fs::path& scene) {
  if (is_file(scene)) {
    const Form* const form = form_of(scene);
    return form ? std::optional<ForeignScene>({scene, form->program}) : std::nullopt;
  }
  std::vector<fs::path> files;
  std::size_t entries = 0;
  collect(scene, 0, entries, files);
  std::stable_sort(files.begin(), files.end(), [](const fs::path& a, const fs::path& b) {
    const auto depth = [](const fs::path& path) { return std::distance(path.begin(), path.end()); };
    return depth(a) != depth(b) ? depth(a) < depth(b) : a < b;
  });
  std::vector<std::string> heads;
  for (const fs::path& file : files) heads.push_back(beginning_of(file));
  for (const Form& form : kForms)
    for (std::size_t i = 0; i < files.size(); ++i)
      if (is_of(form, files[i], heads[i])) return {{files[i], form.program}};
  return std::nullopt;
}

fs::path foreign_photos(const fs::path& scene, const fs::path& named) {
  return is_folder(scene / named) ? scene / named : scene;
}

ColmapModel read_foreign_scene(const fs::path& file, const fs::path& photos) {
  const Form* const form = form_of(file);
  if (!form) cannot_read(file, "it holds no camera poses any more; export them again");
  log_info("the cameras are those of {}, in {}", form->program, file.string());
  ForeignModel model(file, photos);
  form->read(model);
  return model.take();
}

}  // namespace gs
