// SPDX-License-Identifier: Apache-2.0
// Includes and link lines go one way, and a library is seen only by the folder that owns it:
//
//   gs_core <- gs_render <- gs_train <- cuda;   gs_core <- data_loaders;   all of these <- gs_api <- python;   web;
//   cli and tests see everything
//
// This test reads the source tree. The rules are the two tables below; docs/developing.md explains them.
#include <gmock/gmock.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <map>
#include <regex>
#include <set>
#include <sstream>
#include <string>
#include <vector>

namespace gs {
namespace {

namespace fs = std::filesystem;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

/// One file of the tree: its path from the root, with forward slashes, and its text.
struct SourceFile {
  std::string path;
  std::string text;
};

// Folder -> the folders it may include and link, besides itself.
const std::map<std::string, std::set<std::string>> kLayers = {
    {"gs_core", {}},
    {"gs_render", {"gs_core"}},
    {"gs_train", {"gs_core", "gs_render"}},
    {"cuda", {"gs_core", "gs_render", "gs_train"}},
    {"data_loaders", {"gs_core"}},
    {"gs_api", {"gs_core", "gs_render", "gs_train", "cuda", "data_loaders"}},
    {"python", {"gs_core", "gs_render", "gs_train", "data_loaders", "gs_api"}},
    {"web", {}},
    {"cli", {"gs_core", "gs_render", "gs_train", "cuda", "data_loaders", "gs_api", "web"}},
    {"tests",
     {"gs_core", "gs_render", "gs_train", "cuda", "data_loaders", "gs_api", "web", "cli",
      "python"}},
};

/// One header or target that a path may use beside the owners: the beginning of a path, and a whole name.
struct Exemption {
  std::string path;
  std::string name;
};

/// A library with few owners. All are beginnings: of an include's name, of a word of a CMakeLists.txt, and of
/// the paths that may include or link it.
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
     // tests/cuda/step_test.cpp counts what the driver is asked for
     {{"tests/cuda/", "cuda_runtime_api.h"}, {"tests/CMakeLists.txt", "CUDA::cudart_static"}}},
    {"OpenCV", {"opencv"}, {"OpenCV_", "opencv_"}, {"data_loaders/"}, {"data_loaders/"}},
    {"zstd and xxhash",
     {"zstd.h", "xxhash.h"},
     {"GS_ZSTD_", "GS_XXHASH_"},
     {"data_loaders/photo_cache", "data_loaders/checked_file", "data_loaders/formats/compression"},
     {"data_loaders/"}},
    {"zlib", {"zlib.h"}, {"ZLIB::"}, {"data_loaders/formats/compression"}, {"data_loaders/"}},
    {"libwebp", {"webp/"}, {"GS_WEBP_"}, {"data_loaders/formats/webp"}, {"data_loaders/"}},
    {"pybind11",
     {"pybind11/", "Python.h"},
     {"GS_PYBIND11_", "Python3"},
     {"python/"},
     {"python/", "tests/"}},
    {"cpp-httplib",
     {"httplib.h"},
     {"PkgConfig::gs_httplib"},
     {"cli/http_server.cpp", "tests/cli/view_"},
     {"cli/", "tests/"}},
    {"OpenImageIO", {"OpenImageIO/"}, {"OpenImageIO"}, {"data_loaders/"}, {"data_loaders/"}},
    {"Ceres",
     {"ceres/"},
     {"Ceres::", "CERES_"},
     {"data_loaders/refine_", "tests/math/", "tests/support/jet_"},
     {"data_loaders/", "tests/"}},
};

std::string top_folder(const std::string& path) { return path.substr(0, path.find('/')); }

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

/// The layer that an include or a CMake target names, or "" where it names none.
std::string layer_of_include(const SourceFile& file, const std::string& name, bool quoted) {
  const std::string folder = top_folder(name);
  if (kLayers.contains(folder) && name != folder) {
    return folder == "cuda" && !quoted ? "" : folder;  // <cuda/...> is CUDA's own library
  }
  if (!quoted) return "";
  const fs::path beside = fs::path(file.path).parent_path() / name;  // "x.h" and "../folder/x.h"
  const std::string resolved = top_folder(beside.lexically_normal().generic_string());
  return kLayers.contains(resolved) ? resolved : "";
}

std::string layer_of_target(const std::string& word) {
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
  const std::string folder = top_folder(file.path);
  const std::string layer = layer_of_include(file, name, match[1] == "\"");
  if (!layer.empty() && !may_see(folder, layer)) {
    violations.push_back(complaint(file, line, folder + " must not include " + name));
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
  const std::string folder = top_folder(file.path);
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
    if (!kLayers.contains(top_folder(file.path))) continue;
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
    if (!file.text.empty()) folders.insert(top_folder(file.path));
  }
  folders.insert("cuda");  // may be deleted
  EXPECT_EQ(folders.size(), kLayers.size());
}

TEST(Layers, AnIncludeAgainstTheArrowIsNamedWithFileAndLine) {
  EXPECT_THAT(violations_of("gs_core/a.h",
                            "#pragma once\n  #  include \"gs_train/trainer.h\"  // why not\n"),
              ElementsAre("gs_core/a.h:2: gs_core must not include gs_train/trainer.h"));
}

TEST(Layers, AnIncludeAlongTheArrowIsFine) {
  EXPECT_THAT(violations_of("cuda/blend.cu",
                            "#include \"gs_core/math/blend.h\"\n"
                            "#include \"gs_train/backend.h\"\n"
                            "#include \"cuda/warp.cuh\"\n#include \"mma.cuh\"\n"),
              IsEmpty());
  EXPECT_THAT(violations_of("cli/main.cpp", "#include \"cuda/backend.h\"\n"), IsEmpty());
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

TEST(Layers, ARelativeIncludeIsFollowed) {
  EXPECT_THAT(violations_of("gs_render/a.cpp", "#include \"../gs_train/adam.h\"\n"),
              ElementsAre(HasSubstr("gs_render must not include ../gs_train/adam.h")));
  EXPECT_THAT(violations_of("gs_core/math/a.h", "#include \"b.h\"\n#include \"../types.h\"\n"),
              IsEmpty());
}

TEST(Layers, CudaHeadersStayInTheCudaFolder) {
  for (const std::string header :
       {"cuda_runtime.h", "cuda.h", "cuda_fp16.h", "cub/cub.cuh", "thrust/sort.h", "mma.h"}) {
    const std::string text = "#include <" + header + ">\n";
    EXPECT_THAT(violations_of("gs_core/a.h", text), ElementsAre(HasSubstr("CUDA must not")))
        << header;
    EXPECT_THAT(violations_of("tests/stages/a.cpp", text), ElementsAre(HasSubstr("CUDA must not")))
        << header;
    EXPECT_THAT(violations_of("cuda/a.cu", text), IsEmpty()) << header;
  }
}

TEST(Layers, TestsOfCudaMayCountDriverCallsAndNoMore) {
  EXPECT_THAT(violations_of("tests/cuda/a.cpp", "#include <cuda_runtime_api.h>\n"), IsEmpty());
  EXPECT_THAT(violations_of("tests/cuda/a.cpp", "#include <cuda_runtime.h>\n"),
              ElementsAre(HasSubstr("CUDA must not")));
  for (const std::string path : {"tests/stages/a.cpp", "tests/support/cuda.h", "cli/a.cpp"}) {
    EXPECT_THAT(violations_of(path, "#include <cuda_runtime_api.h>\n"),
                ElementsAre(HasSubstr("CUDA must not")))
        << path;
  }
  EXPECT_THAT(violations_of("tests/CMakeLists.txt", "  PRIVATE CUDA::cudart_static)\n"), IsEmpty());
  EXPECT_THAT(violations_of("tests/CMakeLists.txt", "  PRIVATE CUDA::cublas)\n"),
              ElementsAre(HasSubstr("CUDA must not be linked here")));
  EXPECT_THAT(violations_of("cli/CMakeLists.txt", "  PRIVATE CUDA::cudart_static)\n"),
              ElementsAre(HasSubstr("CUDA must not be linked here")));
}

TEST(Layers, ImageLibrariesStayInDataLoaders) {
  for (const std::string header : {"opencv2/core.hpp", "OpenImageIO/imageio.h"}) {
    const std::string text = "#include <" + header + ">\n";
    EXPECT_THAT(violations_of("data_loaders/a.cpp", text), IsEmpty()) << header;
    EXPECT_THAT(violations_of("cli/a.cpp", text), ElementsAre(HasSubstr(header)));
  }
}

TEST(Layers, CeresStaysInRefinementAndTheMathTests) {
  const std::string text = "#include <ceres/jet.h>\n";
  EXPECT_THAT(violations_of("data_loaders/refine_poses.cpp", text), IsEmpty());
  EXPECT_THAT(violations_of("tests/math/sh_test.cpp", text), IsEmpty());
  EXPECT_THAT(violations_of("data_loaders/photos.cpp", text), ElementsAre(HasSubstr("Ceres")));
  EXPECT_THAT(violations_of("gs_core/math/sh.h", text), ElementsAre(HasSubstr("Ceres")));
}

TEST(Layers, LinkLinesMirrorTheIncludes) {
  EXPECT_THAT(violations_of("gs_render/CMakeLists.txt",
                            "# gs_train would be wrong here\n"
                            "gs_library(gs_render\n  SOURCES a.cpp\n  PUBLIC gs_core gs_train)\n"),
              ElementsAre("gs_render/CMakeLists.txt:4: gs_render must not link gs_train"));
  EXPECT_THAT(
      violations_of("gs_train/CMakeLists.txt", "target_link_libraries(gs_train PRIVATE gs_cuda)\n"),
      ElementsAre(HasSubstr("gs_train must not link gs_cuda")));
  EXPECT_THAT(violations_of("gs_core/CMakeLists.txt", "  PRIVATE Ceres::ceres CUDA::cudart)\n"),
              ElementsAre(HasSubstr("Ceres::ceres"), HasSubstr("CUDA::cudart")));
}

}  // namespace
}  // namespace gs
