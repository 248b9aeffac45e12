// SPDX-License-Identifier: Apache-2.0
// Includes and link lines go one way, and only the folder that owns a library sees it:
//
//   gs_core <- gs_render <- gs_train <- gs_eval, cuda;   gs_core <- gs_model <- data_loaders;
//   apps/web is text alone;   all of these <- gs_app <- apps/cli, apps/python;
//   tests see everything
//
// Within most of them the subfolders have an order, too.
//
// This test reads the source tree. The rules are the two tables below; docs/develop/testing.md
// explains them.
#include <fstream>
#include <regex>
#include "tests/support/test.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

/// One file of the tree: its path from the root, with forward slashes, and its text.
struct SourceFile {
  std::string path;
  std::string text;
};

// Folder -> the folders that it may include and link, besides itself.
const std::map<std::string, std::set<std::string>> kLayers = {
    {"gs_core", {}},
    {"gs_render", {"gs_core"}},
    {"gs_train", {"gs_core", "gs_render"}},
    {"gs_eval", {"gs_core", "gs_render", "gs_train"}},
    {"cuda", {"gs_core", "gs_render", "gs_train"}},
    {"gs_model", {"gs_core"}},
    {"data_loaders", {"gs_core", "gs_model"}},
    {"apps/web", {}},
    {"gs_app",
     {"gs_core", "gs_render", "gs_train", "gs_eval", "cuda", "gs_model", "data_loaders",
      "apps/web"}},
    {"apps/python",
     {"gs_core", "gs_render", "gs_train", "gs_eval", "gs_model", "data_loaders", "gs_app"}},
    {"apps/cli",
     {"gs_core", "gs_render", "gs_train", "gs_eval", "gs_model", "data_loaders", "gs_app"}},
    {"tests",
     {"gs_core", "gs_render", "gs_train", "gs_eval", "cuda", "gs_model", "data_loaders", "gs_app",
      "apps/web", "apps/cli", "apps/python"}},
};

// Subfolder -> the subfolders of the same folder that it may include, besides itself. A folder's
// own files (gs_core/types.h) are not in this table.
const std::map<std::string, std::set<std::string>> kRooms = {
    {"gs_core/math", {}},
    {"gs_core/math/lens", {"gs_core/math"}},
    {"gs_core/math/render", {"gs_core/math", "gs_core/math/lens"}},
    {"gs_core/math/loss", {"gs_core/math"}},
    {"gs_core/math/update", {"gs_core/math"}},
    {"gs_core/math/view", {"gs_core/math", "gs_core/math/render"}},
    {"gs_core/math/spacetime", {"gs_core/math", "gs_core/math/render"}},
    {"gs_core/math/pose", {"gs_core/math", "gs_core/math/render", "gs_core/math/spacetime"}},
    {"gs_core/math/density", {"gs_core/math", "gs_core/math/render", "gs_core/math/spacetime"}},
    {"gs_core/system", {}},
    {"gs_core/threads", {"gs_core/system"}},
    {"gs_core/density", {"gs_core/math/density"}},
    {"gs_core/config",
     {"gs_core/density", "gs_core/math", "gs_core/math/density", "gs_core/math/loss",
      "gs_core/math/render", "gs_core/math/update", "gs_core/system"}},
    {"gs_core/forecast",
     {"gs_core/config", "gs_core/density", "gs_core/math", "gs_core/math/density",
      "gs_core/math/render", "gs_core/system"}},
    {"gs_core/geometry",
     {"gs_core/math", "gs_core/math/density", "gs_core/math/render", "gs_core/system",
      "gs_core/threads"}},
    {"gs_core/geodesy", {"gs_core/geometry"}},
    {"gs_render/exact", {}},
    {"gs_render/fusion", {}},
    {"gs_render/mesh", {"gs_render/fusion"}},
    {"gs_render/paths", {}},
    {"gs_render/stages", {}},
    {"gs_model/edit", {"gs_model/formats/coding"}},
    {"gs_model/edit/places", {"gs_model/edit"}},
    {"gs_model/lod", {"gs_model/edit"}},
    {"data_loaders/colmap", {}},
    {"data_loaders/photos/encode", {}},
    {"data_loaders/photos", {"data_loaders/colmap", "data_loaders/photos/encode"}},
    {"data_loaders/lenses", {"data_loaders/colmap"}},
    {"data_loaders/video", {"data_loaders/photos", "data_loaders/photos/encode"}},
    {"gs_model/formats/coding", {}},
    {"gs_model/formats/ply", {"gs_model/formats/coding"}},
    {"gs_model/formats/sog", {"gs_model/formats/coding", "gs_model/formats/ply"}},
    {"gs_model/formats/npz", {"gs_model/edit", "gs_model/formats/coding"}},
    {"gs_model/formats/lod", {"gs_model/formats/coding", "gs_model/lod"}},
    {"gs_model/formats/spz", {"gs_model/formats/coding", "gs_model/formats/ply"}},
    {"gs_model/formats/usd", {"gs_model/edit", "gs_model/formats/coding"}},
    {"gs_model/formats",
     {"gs_model/edit", "gs_model/formats/coding", "gs_model/formats/lod", "gs_model/formats/ply",
      "gs_model/formats/npz", "gs_model/formats/sog", "gs_model/formats/spz",
      "gs_model/formats/usd"}},
    {"gs_model/tiles",
     {"gs_model/edit", "gs_model/formats", "gs_model/formats/coding", "gs_model/formats/spz"}},
    {"gs_model/mesh",
     {"gs_model/formats", "gs_model/formats/coding", "gs_model/formats/ply",
      "gs_model/formats/usd"}},
    {"data_loaders/refine", {"data_loaders/colmap", "data_loaders/lenses", "data_loaders/photos"}},
    {"data_loaders/points", {"data_loaders/colmap"}},
    {"data_loaders/transforms",
     {"data_loaders/colmap", "data_loaders/photos", "data_loaders/points"}},
    {"data_loaders/foreign", {"data_loaders/colmap", "data_loaders/photos"}},
    {"data_loaders/scene",
     {"data_loaders/colmap", "data_loaders/foreign", "data_loaders/lenses", "data_loaders/photos",
      "data_loaders/photos/encode", "data_loaders/points", "data_loaders/refine",
      "data_loaders/transforms", "data_loaders/video"}},
    {"data_loaders/cameras",
     {"data_loaders/colmap", "data_loaders/lenses", "data_loaders/photos", "data_loaders/scene",
      "data_loaders/transforms"}},
    {"data_loaders/georef", {"data_loaders/colmap", "data_loaders/photos"}},
    {"data_loaders/reconstruct",
     {"data_loaders/colmap", "data_loaders/foreign", "data_loaders/lenses", "data_loaders/photos",
      "data_loaders/photos/encode", "data_loaders/video"}},
    {"data_loaders/doctor",
     {"data_loaders/colmap", "data_loaders/lenses", "data_loaders/photos",
      "data_loaders/reconstruct", "data_loaders/scene", "data_loaders/video"}},
    {"gs_train/density", {}},
    {"gs_train/photometric", {}},
    {"gs_train/poses", {}},
    {"gs_train/initialize", {"gs_train/photometric", "gs_train/poses"}},
    {"gs_eval/flip", {}},
    {"gs_eval/lpips", {}},
    {"gs_eval/looks", {}},
    {"cuda/device", {}},
    {"cuda/render/blend", {"cuda/device"}},
    {"cuda/render", {"cuda/device", "cuda/render/blend"}},
    {"cuda/photo_terms", {"cuda/device", "cuda/render"}},
    {"cuda/loss", {"cuda/device", "cuda/photo_terms"}},
    {"cuda/gradients", {"cuda/device", "cuda/render", "cuda/render/blend"}},
    {"cuda/density", {"cuda/device", "cuda/gradients", "cuda/photo_terms", "cuda/render/blend"}},
    {"cuda/step", {"cuda/device", "cuda/photo_terms", "cuda/render"}},
    {"cuda/gpus", {"cuda/device", "cuda/photo_terms", "cuda/render", "cuda/step"}},
    {"cuda/operator", {"cuda/device", "cuda/render", "cuda/render/blend"}},
    {"cuda/fusion", {"cuda/device", "cuda/render", "cuda/render/blend"}},
    {"gs_train/stages", {"gs_train/photometric"}},
    {"gs_train/photo_terms", {"gs_train/photometric", "gs_train/poses", "gs_train/stages"}},
    {"gs_train/loop",
     {"gs_train/density", "gs_train/initialize", "gs_train/photometric", "gs_train/poses"}},
    {"gs_app/run", {}},
    {"gs_app/pictures", {}},
    {"gs_app/export", {"gs_app/run", "gs_app/pictures"}},
    {"gs_app/edit", {"gs_app/run", "gs_app/pictures", "gs_app/export"}},
    {"gs_app/blocks", {"gs_app/run", "gs_app/edit"}},
    {"gs_app/checkpoints", {"gs_app/run"}},
    {"gs_app/observers", {"gs_app/run"}},
    {"gs_app/report", {"gs_app/run", "gs_app/pictures", "gs_app/export"}},
    {"gs_app/session",
     {"gs_app/run", "gs_app/pictures", "gs_app/checkpoints", "gs_app/observers", "gs_app/export",
      "gs_app/report"}},
    {"gs_app/view/http", {}},
    {"gs_app/view",
     {"gs_app/run", "gs_app/pictures", "gs_app/export", "gs_app/edit", "gs_app/observers",
      "gs_app/view/http"}},
    {"gs_app/studio", {"gs_app/run", "gs_app/view", "gs_app/view/http"}},
    {"gs_app/experiment", {"gs_app/run"}},
    {"gs_app/experiment/tables", {"gs_app/experiment", "gs_app/report", "gs_app/run"}},
    {"gs_app/checks", {"gs_app/run"}},
    {"gs_app/jobs/parts", {"gs_app/run", "gs_app/view/http"}},
    {"gs_app/jobs",
     {"gs_app/jobs/parts", "gs_app/run", "gs_app/pictures", "gs_app/export", "gs_app/edit",
      "gs_app/blocks", "gs_app/checkpoints", "gs_app/observers", "gs_app/report", "gs_app/session",
      "gs_app/view", "gs_app/view/http", "gs_app/studio", "gs_app/experiment",
      "gs_app/experiment/tables", "gs_app/checks"}},
};

// Target -> its layer, where the target's name is not "gs_" and the folder.
const std::map<std::string, std::string> kTargets = {
    {"gs_cli", "apps/cli"}, {"gs_python", "apps/python"}, {"gs_web", "apps/web"},
    {"gs_view", "gs_app"},  {"gs_experiment", "gs_app"},  {"gs_checks", "gs_app"},
    {"gs_jobs", "gs_app"},  {"gs_studio", "gs_app"},
};

/// A header or target that certain paths may use although they do not own the library: the
/// beginning of a path, and a complete name.
struct Exemption {
  std::string path;
  std::string name;
};

/// A library with few owners. All strings are beginnings: of the name of an include, of a word in a
/// CMakeLists.txt, and of the paths that may include or link it.
struct OwnedLibrary {
  std::string name;
  std::vector<std::string> includes;
  std::vector<std::string> targets;
  std::vector<std::string> may_include;
  std::vector<std::string> may_link;
  std::vector<Exemption> exemptions = {};
};
const std::vector<OwnedLibrary> kOwnedLibraries = {
    {"CUDA",
     {"cuda_", "cuda.h", "cuda/std/", "cub/", "thrust/", "cublas", "cooperative_groups", "mma.h",
      "nvtx3/"},
     {"CUDA::"},
     {"cuda/"},
     {"cuda/"},
     // tests/cuda/step_test.cpp counts calls of the driver, and operator_test.cpp is a caller with
     // memory and a stream of its own
     {{"tests/cuda/", "cuda_runtime_api.h"}, {"tests/CMakeLists.txt", "CUDA::cudart_static"}}},
    {"OpenCV",
     {"opencv"},
     {"OpenCV_", "opencv_"},
     {"data_loaders/", "gs_eval/lpips/feature_network_opencv"},
     {"data_loaders/", "gs_eval/"}},
    {"zstd and xxhash",
     {"zstd.h", "xxhash.h"},
     {"GS_ZSTD_", "GS_XXHASH_"},
     {"data_loaders/photos/photo_cache", "gs_core/system/files/checked_file",
      "gs_model/formats/coding/compression"},
     {"data_loaders/", "gs_model/"}},
    {"zlib", {"zlib.h"}, {"ZLIB::"}, {"gs_model/formats/coding/compression"}, {"gs_model/"}},
    {"libwebp", {"webp/"}, {"GS_WEBP_"}, {"gs_model/formats/sog/webp"}, {"gs_model/"}},
    {"pugixml",
     {"pugixml"},
     {"GS_PUGIXML_"},
     {"data_loaders/foreign/metashape"},
     {"data_loaders/"}},
    {"pybind11",
     {"pybind11/", "Python.h"},
     {"GS_PYBIND11_", "Python3"},
     {"apps/python/"},
     {"apps/python/", "tests/"}},
    {"OpenImageIO", {"OpenImageIO/"}, {"OpenImageIO"}, {"data_loaders/"}, {"data_loaders/"}},
    {"Ceres",
     {"ceres/"},
     {"Ceres::", "CERES_"},
     {"data_loaders/refine/refine_", "tests/math/", "tests/recipes/lens_", "tests/support/jet_"},
     {"data_loaders/", "tests/"}},
};

/// The longest key of a table whose folder holds the path, or "".
template <class Table>
std::string folder_in(const Table& table, std::string path) {
  for (std::size_t slash; (slash = path.rfind('/')) != path.npos;) {
    path.resize(slash);
    if (table.contains(path)) return path;
  }
  return "";
}

std::string layer_of(const std::string& path) { return folder_in(kLayers, path); }
std::string room_of(const std::string& path) { return folder_in(kRooms, path); }

bool begins_with_any(const std::string& text, const std::vector<std::string>& beginnings) {
  return std::any_of(beginnings.begin(), beginnings.end(),
                     [&](const std::string& start) { return text.starts_with(start); });
}

bool is_exempt(const OwnedLibrary& library, const std::string& path, const std::string& name) {
  return std::any_of(library.exemptions.begin(), library.exemptions.end(),
                     [&](const Exemption& exemption) {
                       return path.starts_with(exemption.path) && name == exemption.name;
                     });
}

bool may_see(const std::string& folder, const std::string& other) {
  return folder == other || kLayers.at(folder).contains(other);
}

bool room_may_see(const std::string& room, const std::string& other) {
  return room.empty() || other.empty() || room == other || kRooms.at(room).contains(other);
}

/// The path from the root that a quoted include names: as it is, or beside the file.
std::string included_path(const SourceFile& file, const std::string& name) {
  if (!layer_of(name).empty()) return name;
  const fs::path beside = fs::path(file.path).parent_path() / name;  // "x.h" and "../folder/x.h"
  return beside.lexically_normal().generic_string();
}

/// The layer that an include names, or "" where it names none. <cuda/...> is CUDA's own library.
std::string layer_of_include(const SourceFile& file, const std::string& name, bool quoted) {
  if (quoted) return layer_of(included_path(file, name));
  const std::string layer = layer_of(name);
  return layer == "cuda" ? "" : layer;
}

std::string layer_of_target(const std::string& word) {
  if (const auto named = kTargets.find(word); named != kTargets.end()) return named->second;
  for (const auto& [folder, unused] : kLayers) {
    if (word == folder || word == "gs_" + folder) return folder;
  }
  return "";
}

std::string complaint(const SourceFile& file, int line, const std::string& what) {
  return file.path + ":" + std::to_string(line) + ": " + what;
}

void check_include(const SourceFile& file, int line, const std::string& text,
                   std::vector<std::string>& violations) {
  static const std::regex include_line("^\\s*#\\s*include\\s*([\"<])([^\">]+)[\">].*");
  std::smatch match;
  if (!std::regex_match(text, match, include_line)) return;
  const std::string name = match[2];
  const std::string folder = layer_of(file.path);
  const std::string layer = layer_of_include(file, name, match[1] == "\"");
  if (!layer.empty() && !may_see(folder, layer)) {
    violations.push_back(complaint(file, line, folder + " must not include " + name));
  }
  const std::string room = room_of(file.path), other = room_of(included_path(file, name));
  if (layer == folder && !room_may_see(room, other)) {
    violations.push_back(complaint(file, line, room + " must not include " + name));
  }
  for (const OwnedLibrary& library : kOwnedLibraries) {
    if (layer.empty() && begins_with_any(name, library.includes) &&
        !begins_with_any(file.path, library.may_include) && !is_exempt(library, file.path, name)) {
      violations.push_back(
          complaint(file, line, library.name + " must not be included here: " + name));
    }
  }
}

void check_link_words(const SourceFile& file, int line, const std::string& text,
                      std::vector<std::string>& violations) {
  static const std::regex word_pattern("[A-Za-z0-9_:]+");
  const std::string code = text.substr(0, text.find('#'));
  const std::string folder = layer_of(file.path);
  for (std::sregex_iterator it(code.begin(), code.end(), word_pattern), end; it != end; ++it) {
    const std::string word = it->str();
    const std::string layer = layer_of_target(word);
    if (!layer.empty() && !may_see(folder, layer)) {
      violations.push_back(complaint(file, line, folder + " must not link " + word));
    }
    for (const OwnedLibrary& library : kOwnedLibraries) {
      if (begins_with_any(word, library.targets) && !begins_with_any(file.path, library.may_link) &&
          !is_exempt(library, file.path, word)) {
        violations.push_back(
            complaint(file, line, library.name + " must not be linked here: " + word));
      }
    }
  }
}

/// Every line that breaks a rule, as "path:line: what"; files outside the layers are not looked at.
std::vector<std::string> find_layer_violations(const std::vector<SourceFile>& files) {
  std::vector<std::string> violations;
  for (const SourceFile& file : files) {
    if (!kLayers.contains(layer_of(file.path))) continue;
    const bool is_cmake = file.path.ends_with("CMakeLists.txt");
    std::istringstream lines(file.text);
    std::string text;
    for (int line = 1; std::getline(lines, text); ++line) {
      (is_cmake ? check_link_words : check_include)(file, line, text, violations);
    }
  }
  return violations;
}

/// Sources and CMakeLists.txt of every layer that exists; cuda/ may be deleted.
std::vector<SourceFile> read_layers(const fs::path& root) {
  static const std::set<std::string> kExtensions = {".h", ".cpp", ".cu", ".cuh"};
  std::vector<SourceFile> files;
  for (const auto& [folder, unused] : kLayers) {
    if (!fs::exists(root / folder)) continue;
    for (const auto& entry : fs::recursive_directory_iterator(root / folder)) {
      const fs::path& path = entry.path();
      if (!kExtensions.contains(path.extension().string()) && path.filename() != "CMakeLists.txt") {
        continue;
      }
      std::ifstream stream(path, std::ios::binary);
      files.push_back({fs::relative(path, root).generic_string(),
                       {std::istreambuf_iterator<char>(stream), std::istreambuf_iterator<char>()}});
    }
  }
  return files;
}

std::vector<std::string> violations_of(const std::string& path, const std::string& text) {
  return find_layer_violations({{path, text}});
}

TEST(Layers, TheSourceTreeHasNoViolation) {
  EXPECT_THAT(find_layer_violations(read_layers(GS_SOURCE_DIR)), IsEmpty());
}

TEST(Layers, TheSourceTreeIsRead) {
  std::set<std::string> folders;
  for (const SourceFile& file : read_layers(GS_SOURCE_DIR)) {
    if (!file.text.empty()) folders.insert(layer_of(file.path));
  }
  folders.insert("cuda");  // may be deleted
  EXPECT_EQ(folders.size(), kLayers.size());
}

TEST(Layers, EveryFolderMayIncludeOnlyWhatTheTableSays) {
  for (const auto& [from, allowed] : kLayers) {
    for (const auto& [to, unused] : kLayers) {
      const bool fine = from == to || allowed.contains(to);
      EXPECT_EQ(violations_of(from + "/a.h", "#include \"" + to + "/b.h\"\n").empty(), fine)
          << from << " includes " << to;
    }
  }
}

TEST(Layers, TheTableOfSubfoldersHasNoCircle) {
  for (const auto& [room, allowed] : kRooms) {
    std::set<std::string> below = allowed;
    for (std::size_t before = 0; before != below.size();) {
      before = below.size();
      for (const std::string& other : std::set<std::string>(below))
        below.insert(kRooms.at(other).begin(), kRooms.at(other).end());
    }
    EXPECT_FALSE(below.contains(room)) << room << " includes itself through others";
  }
}

TEST(Layers, ARelativeIncludeIsFollowed) {
  EXPECT_THAT(violations_of("gs_render/a.cpp", "#include \"../gs_train/stages/adam.h\"\n"),
              ElementsAre(HasSubstr("gs_render must not include ../gs_train/stages/adam.h")));
  EXPECT_THAT(violations_of("gs_core/math/a.h", "#include \"b.h\"\n#include \"../types.h\"\n"),
              IsEmpty());
}

/// One line of a file, and what is said of it; "": nothing.
struct Judged {
  const char *path, *line, *complaint;
};

TEST(Layers, EachRuleIsKeptAndALineThatBreaksItIsNamed) {
  const Judged lines[] = {
      {"gs_core/a.h", "  #  include \"gs_train/loop/trainer.h\"  // why not",
       "gs_core/a.h:2: gs_core must not include gs_train/loop/trainer.h"},
      {"cuda/render/blend/blend.cu", "#include \"gs_core/math/render/blend.h\"", ""},
      {"cuda/render/blend/blend.cu", "#include \"cuda/device/warp.cuh\"", ""},
      {"gs_app/run/make_backend.cpp", "#include \"cuda/backend.h\"", ""},
      {"data_loaders/scene/a.cpp", "#include \"data_loaders/colmap/b.h\"", ""},
      {"data_loaders/colmap/a.cpp", "#include \"data_loaders/scene/b.h\"",
       "data_loaders/colmap must not include data_loaders/scene/b.h"},
      {"data_loaders/colmap/a.cpp", "#include \"../scene/b.h\"",
       "data_loaders/colmap must not include ../scene/b.h"},
      {"gs_core/a.h", "#include <cub/cub.cuh>", "CUDA must not be included here"},
      {"tests/stages/a.cpp", "#include <mma.h>", "CUDA must not be included here"},
      {"cuda/a.cu", "#include <thrust/sort.h>", ""},
      // Tests of CUDA may count calls of the driver.
      {"tests/cuda/a.cpp", "#include <cuda_runtime_api.h>", ""},
      {"tests/cuda/a.cpp", "#include <cuda_runtime.h>", "CUDA must not be included here"},
      {"tests/support/cuda.h", "#include <cuda_runtime_api.h>", "CUDA must not be included here"},
      {"tests/CMakeLists.txt", "  PRIVATE CUDA::cudart_static)", ""},
      {"tests/CMakeLists.txt", "  PRIVATE CUDA::cublas)", "CUDA must not be linked here"},
      {"apps/cli/CMakeLists.txt", "  CUDA::cudart_static)", "CUDA must not be linked here"},
      {"data_loaders/a.cpp", "#include <OpenImageIO/imageio.h>", ""},
      {"apps/cli/a.cpp", "#include <OpenImageIO/imageio.h>", "OpenImageIO/imageio.h"},
      {"apps/cli/a.cpp", "#include <opencv2/core.hpp>", "opencv2/core.hpp"},
      {"data_loaders/refine/refine_poses.cpp", "#include <ceres/jet.h>", ""},
      {"tests/math/sh_test.cpp", "#include <ceres/jet.h>", ""},
      {"data_loaders/photos/photos.cpp", "#include <ceres/jet.h>", "Ceres must not"},
      {"gs_core/CMakeLists.txt", "  PRIVATE Ceres::ceres)", "Ceres must not be linked here"},
      {"gs_render/CMakeLists.txt", "# gs_train would be wrong here", ""},
      {"gs_render/CMakeLists.txt", "  PUBLIC gs_core gs_train)",
       "gs_render/CMakeLists.txt:2: gs_render must not link gs_train"},
      {"gs_train/CMakeLists.txt", "target_link_libraries(gs_train PRIVATE gs_cuda)",
       "gs_train must not link gs_cuda"}};
  for (const auto& [path, line, complaint] : lines) {
    const auto said = violations_of(path, "\n" + std::string(line) + "\n");
    if (*complaint)
      EXPECT_THAT(said, ElementsAre(HasSubstr(complaint))) << path << ": " << line;
    else
      EXPECT_THAT(said, IsEmpty()) << path << ": " << line;
  }
}

}  // namespace
}  // namespace gs
