// SPDX-License-Identifier: Apache-2.0
// Writes the binary seeds of corpus/ with our own writers; the others are text, and what fuzzers
// found. The same tree gives the same bytes:
//   cmake --build build/fuzz --target make_fuzz_corpus && build/fuzz/tests/make_fuzz_corpus
#include <cstdio>

#include "data_loaders/photos/exr.h"
#include "data_loaders/photos/photo_cache.h"
#include "data_loaders/photos/photos.h"
#include "gs_app/checkpoints/checkpoint_file.h"
#include "gs_model/formats/coding/compression.h"
#include "gs_model/formats/coding/little_endian.h"
#include "gs_model/formats/formats.h"
#include "gs_model/formats/sog/webp.h"
#include "gs_model/formats/sog/zip_file.h"
#include "gs_model/formats/spz/spz_layout.h"
#include "tests/fuzz/fuzz_target.h"
#include "tests/support/avi_writer.h"
#include "tests/support/colmap_writer.h"
#include "tests/support/glb_parts.h"
#include "tests/support/lpips_file.h"
#include "tests/support/models.h"
#include "tests/support/random_model.h"
#include "tests/support/tiny_photos.h"

namespace gs::fuzz {
namespace {

namespace fs = std::filesystem;
using namespace std::string_literals;

void write_seed(const std::string& name, const std::string& bytes) {
  write_bytes(fs::path(GS_SOURCE_DIR) / "tests/fuzz/corpus" / name, bytes);
}

/// The bytes that our writer makes of a model.
std::string bytes_of(const std::string& file, const GaussianModel& model,
                     const ExportOptions& options = {}) {
  write_model(folder() / file, model, options);
  return read_bytes(folder() / file);
}

std::string joined(const std::vector<std::string>& files) {
  std::string bytes = files.at(0);
  for (std::size_t i = 1; i < files.size(); ++i) bytes += std::string(kNextFile) + files[i];
  return bytes;
}

/// meta.json and the pixels of an archive, as sog.cpp packs them. Only the palette has a width that
/// matters.
std::string unpacked_sog(const std::string& archive) {
  const auto entries = zip_entries("", archive);
  std::vector<std::string> parts = {"#" + std::string(entries.at("meta.json"))};
  for (const char* name :
       {"means_l", "means_u", "quats", "scales", "sh0", "shN_centroids", "shN_labels"}) {
    const auto entry = entries.find(name + ".webp"s);
    if (entry == entries.end()) continue;
    const Image8 picture = read_webp("", name, entry->second, 1 << 20);
    const bool is_palette = name == "shN_centroids"s;
    parts.push_back(std::string(1, is_palette ? char(picture.width / 4 - 1) : '\0'));
    parts.back().append(picture.pixels.begin(), picture.pixels.end());
  }
  return joined(parts);
}

void write_networks() {
  for (const char* network : {"alex", "vgg"})
    write_seed("lpips/"s + network, safetensors_bytes(patterned_network(network, {1, 1, 1, 1, 1})));
}

void write_models() {
  const GaussianModel model = random_model(3, 1), flat = random_model(3, 0);
  write_seed("ply/binary", bytes_of("a.ply", model));
  write_seed("ply/compressed", bytes_of("a.compressed.ply", model));
  write_seed("splat/file", bytes_of("a.splat", flat));
  write_seed("glb/file", bytes_of("a.glb", random_model(2, 0)));
  const GlbParts glb = glb_parts(bytes_of("a.glb", random_model(2, 1)));
  write_seed("glb/parts", joined({glb.json.dump(), glb.binary}));
  write_seed("gs4d/model", bytes_of("a.gs4d", random_moving_model(3, 1)));
  write_seed("spz/version_3", bytes_of("a.spz", model));
  write_seed("spz/version_4", bytes_of("a.spz", model, {4}));
  const std::size_t bytes = kSpzHeaderBytes + 3 * (9 + 1 + 3 + 3 + 4 + 9);
  std::string unpacked = "#" + gunzip("", bytes_of("a.spz", model), bytes, true);
  write_seed("spz/unpacked_3", unpacked);
  unpacked[5] = 4;
  write_seed("spz/unpacked_4", unpacked);
  write_seed("rad/file", bytes_of("a.rad", model));
  write_seed("sog/archive", bytes_of("a.sog", flat));
  const std::string archive = bytes_of("a.sog", random_model(10, 1));
  write_seed("sog/folder", std::string(zip_entries("", archive).at("meta.json")));
  write_seed("sog/unpacked", unpacked_sog(bytes_of("a.sog", flat)));
  write_seed("sog/unpacked_sh", unpacked_sog(bytes_of("a.sog", model)));
}

void write_colmap() {
  ColmapModel model = small_model(4);
  model.cameras[8] = {8, CameraModel::opencv, 12, 8, {10, 11, 6.5, 3.5, 0.1, 0.01, 0, 0}};
  model.images[3].camera_id = 8;
  model.images[0].observations = {{5, 3.5, 4.5}, {900000000000, 2, 1}};
  model.rigs.push_back(
      {1, {{7, true, {1, 0, 0, 0}, {0, 0, 0}}, {8, true, {1, 0, 0, 0}, {1, 0, 0}}}});
  model.frames.push_back({1, 1, {1, 2}});
  write_seed("colmap_binary/rig",
             joined({binary_cameras(model), binary_images(model), binary_points(model),
                     binary_rigs(model), binary_frames(model)}));
  write_text_model(folder() / "text", model);
  const auto text = [](const char* name) { return read_bytes(folder() / "text" / name); };
  write_seed("colmap_text/rig",
             joined({text("cameras.txt"), text("images.txt"), text("points3D.txt"),
                     text("rigs.txt"), text("frames.txt")}));
}

/// The file with a config of one line in place of all settings, which take long to parse.
std::string with_short_config(std::string checkpoint) {
  const std::string name = "config"s + std::string(26, '\0'), config = "train.seed = 7\n";
  const std::size_t at = checkpoint.find(name) + name.size();
  const auto bytes = load_little<std::uint64_t>(checkpoint.data() + at);
  return checkpoint.replace(at, sizeof bytes + bytes, Bytes().add(config.size()).str() + config);
}

void write_run_files() {
  Config config;
  SceneRecord scene;
  scene.views.push_back({"a.png", false, {}, Vec3f(1, 0.9f, 1), 77});
  Camera& camera = scene.views[0].camera;
  camera.width = 12;
  camera.height = 8;
  camera.fx = camera.fy = 10;
  const TrainingModel model = model_of(random_model(2, 1).gaussians);
  write_checkpoint(folder() / "a.ckpt", config, scene, {7, 1, 0.25, 3, 100, {0}, {0}}, model);
  write_seed("checkpoint/step_7", with_short_config(read_bytes(folder() / "a.ckpt")));

  const std::string key(32, '0');  // as in photo_cache.cpp
  Image8 photo(5, 3, 3);
  for (std::size_t i = 0; i < photo.pixels.size(); ++i) photo.pixels[i] = std::uint8_t(i * i);
  PhotoCache(folder(), 1 << 20).store(key, photo);
  write_seed("photo_cache/photo", read_bytes(folder() / "00" / (key + ".gsphoto")));
}

template <std::size_t n>
std::string bytes_of(const unsigned char (&array)[n]) {
  return std::string(reinterpret_cast<const char*>(array), n);
}

/// Whole pictures where we have one; of the other formats the header, which is all that we read.
void write_pictures() {
  write_seed("pictures/png", bytes_of(kGrayPng));
  write_seed("pictures/png_alpha", bytes_of(kRgbaPng));
  write_seed("pictures/jpeg", bytes_of(kTurnedJpeg));
  write_seed("pictures/gif", "GIF89a\x02\0\x01\0\0\0\0;"s);
  write_seed("pictures/bmp", "BM"s + std::string(12, '\0') + "\x28\0\0\0\x02\0\0\0\x01\0\0\0"s);
  write_seed("pictures/webp", "RIFF\0\0\0\0WEBPVP8X\x0A\0\0\0\0\0\0\0\x01\0\0\0\0\0"s);
  write_seed(
      "pictures/tiff",
      "II*\0\x08\0\0\0\x02\0\0\x01\x03\0\x01\0\0\0\x02\0\0\0\x01\x01\x03\0\x01\0\0\0\x01\0\0\0"s);
  write_seed("pictures/big_tiff",
             "MM\0\x2B\0\x08\0\0\0\0\0\0\0\0\0\x10\0\0\0\0\0\0\0\x01\x01\0\0\x03\0\0\0\0\0\0\0\x01"
             "\0\x02\0\0\0\0\0\0"s);
  write_seed("pictures/heif",
             "\0\0\0\x18"
             "ftypheic\0\0\0\0ispe\0\0\0\0\0\0\0\x02\0\0\0\x01"s);
  write_seed("pictures/jpeg_2000",
             "\xFF\x4F\xFF\x51\0\x29\0\0\0\0\0\x02\0\0\0\x01"s + std::string(24, '\0') + "\0\x03"s);
}

/// Whole photos behind the byte that chooses their ending in photos.cpp, and a video of three frames
/// behind those that choose what is asked of it in videos.cpp.
void write_photos_and_videos() {
  Image8 photo(8, 4, 4);
  for (std::size_t i = 0; i < photo.pixels.size(); ++i) photo.pixels[i] = std::uint8_t(5 * i);
  Image8 frame(8, 4, 3);
  const auto jpeg = encode_jpeg(frame, 90);
  write_seed("photos/jpeg", "\0"s + std::string(jpeg.begin(), jpeg.end()));
  write_seed("photos/jpeg_turned", "\0"s + bytes_of(kTurnedJpeg));
  write_seed("photos/png_alpha", "\1"s + bytes_of(kRgbaPng));
  write_seed("photos/tiff",
             "\2II*\0\x08\0\0\0\x08\0"
             "\0\x01\x03\0\x01\0\0\0\x02\0\0\0\x01\x01\x03\0\x01\0\0\0\x01\0\0\0"
             "\x02\x01\x03\0\x01\0\0\0\x08\0\0\0\x03\x01\x03\0\x01\0\0\0\x01\0\0\0"
             "\x06\x01\x03\0\x01\0\0\0\x01\0\0\0\x11\x01\x04\0\x01\0\0\0\x6E\0\0\0"
             "\x16\x01\x03\0\x01\0\0\0\x01\0\0\0\x17\x01\x04\0\x01\0\0\0\x02\0\0\0"
             "\0\0\0\0\x40\x80"s);
  write_seed("photos/bmp",
             "\3BM\x3E\0\0\0\0\0\0\0\x36\0\0\0\x28\0\0\0\x02\0\0\0\x01\0\0\0\x01\0\x18"
             "\0\0\0\0\0\x08\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0"
             "abcdef\0\0"s);
  write_seed("photos/webp", "\4"s + webp_of(photo));
  write_seed("photos/hdr", "\6#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 1 +X 2\nabc\x80xyz\x80"s);
  write_seed("photos/tga", "\7\0\0\x02\0\0\0\0\0\0\0\0\0\x02\0\x01\0\x18\0xyzabc"s);
  ImageF depth(4, 3, 1);
  for (std::size_t i = 0; i < depth.pixels.size(); ++i) depth.pixels[i] = float(i);
  if (can_write_exr()) {
    write_exr(folder() / "a.exr", depth, {"Z"});
    write_seed("photos/exr", "\5"s + read_bytes(folder() / "a.exr"));
  }
  std::vector<Image8> frames(3, frame);
  for (std::size_t i = 0; i < frames[1].pixels.size(); ++i)
    frames[1].pixels[i] = std::uint8_t(37 * i);
  write_avi(folder() / "a.avi", frames);
  write_seed("videos/avi", "\1\2\0"s + read_bytes(folder() / "a.avi"));
}

}  // namespace
}  // namespace gs::fuzz

int main() {
  using namespace gs::fuzz;
  write_models();
  write_networks();
  write_colmap();
  write_run_files();
  write_pictures();
  write_photos_and_videos();
  std::puts("the binary seeds of tests/fuzz/corpus were written");
}
