// SPDX-License-Identifier: Apache-2.0
// Thousands of damaged files for every reader. Each is either read or refused with an Error; nothing crashes, hangs or asks for
// memory that a file of that size cannot need. Under the preset `debug` the sanitizers look on. The damage depends on the
// number of the case alone, which failures name: GS_FUZZ_FIRST and GS_FUZZ_CASES run that one again, or more of them.
#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <cstdlib>
#include <new>
#include <random>

#include "data_loaders/camera_file.h"
#include "data_loaders/load_scene.h"
#include "data_loaders/ply.h"
#include "data_loaders/transforms_json.h"
#include "gs_core/error.h"
#include "gs_core/log.h"
#include "tests/support/colmap_writer.h"
#include "tests/support/foreign_leaks.h"
#include "tests/support/tiny_photos.h"

namespace {

constexpr std::size_t kLargestAllocation = std::size_t(256) << 20;  // bytes; no file here has more than a few thousand
std::atomic<std::size_t> largest_allocation{0};

}  // namespace

#ifdef __SANITIZE_ADDRESS__
extern "C" const char* __asan_default_options();
const char* __asan_default_options() {
  return "max_allocation_size_mb=256:allocator_may_return_null=0";
}
#else
[[gnu::noinline]] void* operator new(std::size_t bytes) {
  std::size_t before = largest_allocation;
  while (bytes > before && !largest_allocation.compare_exchange_weak(before, bytes)) {
  }
  if (void* memory = std::malloc(bytes ? bytes : 1)) return memory;
  throw std::bad_alloc();
}
[[gnu::noinline]] void operator delete(void* memory) noexcept { std::free(memory); }
[[gnu::noinline]] void operator delete(void* memory, std::size_t) noexcept { std::free(memory); }
#endif

namespace gs {
namespace {

namespace fs = std::filesystem;

/// A file, and what reads it.
struct Target {
  fs::path file;
  void (*read)(const fs::path& scene);
};

template <std::size_t n>
std::string bytes_of(const unsigned char (&array)[n]) {
  return std::string(reinterpret_cast<const char*>(array), n);
}

/// One good file of each kind; damaged ones take their places in turn.
class Corpus {
 public:
  Corpus() {
    ColmapModel model = small_model(4);
    model.cameras[8] = {8, CameraModel::opencv, 12, 8, {10, 11, 6.5, 3.5, 0.1, 0.01, 0, 0}};
    model.images[3].camera_id = 8;
    model.rigs.push_back(
        {1, {{7, true, {1, 0, 0, 0}, {0, 0, 0}}, {8, true, {1, 0, 0, 0}, {1, 0, 0}}}});
    model.frames.push_back({1, 1, {1, 2}});
    write_scene(path("binary"), model);
    write_scene(path("text"), model);
    fs::remove_all(path("text/sparse"));
    write_text_model(path("text/sparse/0"), model);
    for (const char* name : {"cameras", "images", "points3D", "rigs", "frames"}) {
      targets_.push_back({path("binary/sparse/0") / (std::string(name) + ".bin"), read_binary});
      targets_.push_back({path("text/sparse/0") / (std::string(name) + ".txt"), read_text});
    }
    write_bytes(
        path("transforms/transforms.json"),
        "{\"camera_model\": \"OPENCV\", \"fl_x\": 10.5, \"fl_y\": 11, \"cx\": 6, \"cy\": 4, \"w\": "
        "12, \"h\": 8, "
        "\"k1\": 0.1, \"ply_file_path\": \"points.ply\", \"frames\": [{\"file_path\": \"a.png\", "
        "\"transform_matrix\": [[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]}, {\"file_path\": "
        "\"b.png\", \"fl_x\": 12, "
        "\"transform_matrix\": [[0,-1,0,2],[1,0,0,0.5],[0,0,1,-3e0],[0,0,0,1]]}]}");
    write_point_ply(path("transforms/points.ply"),
                    {{{1, 2, 3}, {4, 5, 6}}, {{0, 0, 1}, {255, 0, 1}}});
    const auto transforms = [](const fs::path& root) { read_transforms(root / "transforms"); };
    targets_.push_back({path("transforms/transforms.json"), transforms});
    targets_.push_back({path("transforms/points.ply"), transforms});
    GaussianModel gaussians{Gaussians(3, host_memory()), 1, false, false};
    for_each_array([](const char*, auto& array) { array.fill_zero(); }, gaussians.gaussians);
    for (std::size_t i = 0; i < 3; ++i) gaussians.gaussians.rotation[i] = {1, 0, 0, 0};
    write_gaussian_ply(path("trained.ply"), gaussians);
    targets_.push_back({path("trained.ply"),
                        [](const fs::path& root) { read_gaussian_ply(root / "trained.ply"); }});
    write_bytes(path("photo.jpg"), bytes_of(kTurnedJpeg));
    targets_.push_back({path("photo.jpg"), [](const fs::path& root) {
                          read_photo_size(root / "photo.jpg");
                          read_photo(root / "photo.jpg");
                        }});
    write_png(path("photo.png"), plain_photo(12, 8, 77));
    targets_.push_back({path("photo.png"), [](const fs::path& root) {
                          read_photo_size(root / "photo.png");
                          read_photo(root / "photo.png");
                        }});
    for (const Target& target : targets_) originals_.push_back(read_bytes(target.file));
  }

  /// Every file as it should be is read without complaint.
  void read_all() const {
    for (const Target& target : targets_) target.read(temp_.path());
  }
  /// Damages one file, reads it, and mends it. Returns what has gone wrong, or nothing.
  std::string try_case(unsigned number) {
    std::mt19937 random(number);
    const std::size_t which = random() % targets_.size();
    const Target& target = targets_[which];
    write_bytes(target.file, damaged(originals_[which], random));
    const auto begin = std::chrono::steady_clock::now();
    largest_allocation = 0;
    std::string trouble;
    try {
      const IgnoreForeignLeaks image_libraries;
      target.read(temp_.path());
    } catch (const Error& error) {
      const std::string said = error.what();
      if (said.size() < 10) trouble = "an error that says nothing";
      if (said != printable(said)) trouble = "an error that is not text";
    } catch (const std::exception& error) {
      trouble = std::string("not an Error: ") + error.what();
    }
    const std::chrono::duration<double> seconds = std::chrono::steady_clock::now() - begin;
    if (seconds.count() > 1) trouble += " took " + std::to_string(seconds.count()) + " s";
    if (largest_allocation > kLargestAllocation)
      trouble += " asked for " + std::to_string(largest_allocation) + " bytes";
    write_bytes(target.file, originals_[which]);
    return trouble.empty() ? "" : target.file.filename().string() + ": " + trouble;
  }

 private:
  fs::path path(const std::string& name) const { return temp_.path() / name; }
  static void read_binary(const fs::path& root) { load(root / "binary"); }
  static void read_text(const fs::path& root) { load(root / "text"); }
  static void load(const fs::path& scene) {
    DatasetConfig dataset;
    dataset.source = scene.string();
    read_colmap_model(scene / "sparse/0");
    check_scene(dataset);
  }

  static std::string damaged(std::string bytes, std::mt19937& random) {
    for (unsigned round = 0, rounds = 1 + random() % 4; round < rounds; ++round)
      damage(bytes, random);
    return bytes;
  }
  static void damage(std::string& bytes, std::mt19937& random) {
    if (bytes.empty()) bytes = "x";
    const std::size_t at = random() % bytes.size();
    const std::size_t length = std::min<std::size_t>(1 + random() % 16, bytes.size() - at);
    switch (random() % 9) {
      case 0: bytes[at] = char(bytes[at] ^ (1 << random() % 8)); break;
      case 1: bytes[at] = char(random()); break;
      case 2: bytes.resize(at); break;
      case 3: bytes.erase(at, length); break;
      case 4: bytes.insert(at, bytes.substr(random() % bytes.size(), 64)); break;
      case 5: std::fill_n(bytes.begin() + at, length, random() % 2 ? '\xff' : '\0'); break;
      case 6: {  // a number of eight bytes: huge, negative, not a number
        const std::uint64_t numbers[] = {~0ull, 1ull << 62, 0x7ff8000000000000ull,
                                         0xfff0000000000000ull, 1ull << 31};
        for (std::size_t i = 0; i < std::min<std::size_t>(8, bytes.size() - at); ++i)
          bytes[at + i] = char(numbers[random() % 5] >> 8 * i);
        break;
      }
      case 7: {  // words in text files
        const char* const words[] = {"nan",  "-1", "1e999", "99999999999999999999", "\"", "[", "}",
                                     "\r\n", "0x", " "};
        bytes.insert(at, words[random() % 10]);
        break;
      }
      case 8: std::swap(bytes[at], bytes[random() % bytes.size()]); break;
    }
  }

  TempFolder temp_;
  std::vector<Target> targets_;
  std::vector<std::string> originals_;
};

unsigned number_in(const char* variable, unsigned otherwise) {
  const char* const text = std::getenv(variable);
  return text ? unsigned(std::strtoul(text, nullptr, 10)) : otherwise;
}

TEST(Fuzz, DamagedFilesAreReadOrRefused) {
  setup_log(Verbosity::quiet);
  Corpus corpus;
  corpus.read_all();
  const unsigned first = number_in("GS_FUZZ_FIRST", 0), cases = number_in("GS_FUZZ_CASES", 10'000);
  for (unsigned number = first; number < first + cases; ++number) {
    const std::string trouble = corpus.try_case(number);
    EXPECT_EQ(trouble, "") << "case " << number;
  }
}

}  // namespace
}  // namespace gs
