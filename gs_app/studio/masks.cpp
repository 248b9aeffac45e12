// SPDX-License-Identifier: Apache-2.0
#include "gs_app/studio/masks.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>

#include "data_loaders/photos/encode/encode_png.h"
#include "data_loaders/photos/orientation.h"
#include "data_loaders/photos/photo_fit.h"
#include "data_loaders/photos/photo_names.h"
#include "data_loaders/reconstruct/photo_folder.h"
#include "data_loaders/scene/view_picture.h"
#include "gs_core/error.h"
#include "gs_core/system/files/access.h"
#include "gs_core/system/files/atomic_file.h"
#include "gs_core/threads/parallel.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

fs::path mask_file(const Project& project, const std::string& photo) {
  return project.folder / "masks" / (safe_path(photo).generic_string() + ".png");
}

// A mask that a page has sent, of the shape of the photo that it shows. It goes through a file,
// which decoders read. Its size comes from the header, before anything is unpacked.
Image8 decoded(const std::string& png, const PhotoSize& photo, const fs::path& beside) {
  if (!png.starts_with("\x89PNG")) throw UsageError("the mask is no PNG; load the page again");
  fs::create_directories(beside.parent_path());
  struct Temporary {
    fs::path path;
    ~Temporary() {
      std::error_code none;
      fs::remove(path, none);
    }
  };
  const Temporary file{make_temporary_beside(beside, ".png")};
  {
    AtomicFile whole(file.path);
    whole.write(png.data(), png.size());
    whole.commit(AtomicFile::Durability::unsynced);
  }
  try {
    const auto [width, height] = read_photo_size(file.path);
    if (std::max(width, height) > kLongestMaskSide)
      throw UsageError(fmt::format("a mask has at most {} pixels on a side, and this one is {}x{}",
                                   kLongestMaskSide, width, height));
    if (!has_shape_of({width, height}, photo))
      throw UsageError("the mask has another shape than its photo; load the page again");
    return read_mask_file(file.path);
  } catch (const AccessError&) {
    throw;
  } catch (const UsageError&) {
    throw;
  } catch (const Error&) {
    throw UsageError("the mask is a damaged PNG; load the page again");
  }
}

bool hides_nothing(const Image8& mask) {
  return std::all_of(mask.pixels.begin(), mask.pixels.end(),
                     [](auto value) { return value == 255; });
}

int orientation_of(const Project& project, const std::string& photo) {
  return read_photo_orientation(photo_folder_of(project) / photo);
}

// A photo's own alpha counts, too, where it trains with a mask.
Image8 with_alpha_of(const fs::path& photo, Image8 mask) {
  const std::string ending = lowercase_ending(photo);
  if (ending == ".jpg" || ending == ".jpeg") return mask;
  const Image8 alpha = read_photo_with_alpha(photo).alpha;
  if (alpha.empty()) return mask;
  mask = area_resized(mask, alpha.width, alpha.height);
  leave_out(alpha, mask);
  return mask;
}

// By how much `reconstruct` got each photo turned.
std::map<std::string, int> turns_of_scene(const Project& project, const std::string& scene) {
  for (const StudioJob& job : project.jobs)
    if (job.verb() == "reconstruct" && job.output() == scene) return job.turned;
  return {};
}

// Whether the person has said where the masks are.
bool names_masks(const std::vector<std::string>& words) {
  return std::any_of(words.begin(), words.end(), [](const std::string& word) {
    return word == "--masks" || word.starts_with("--masks=") || word.starts_with("dataset.masks=");
  });
}

// The words and files that say which photos and masks a job on a scene gets.
void give_scene(const Project& project, const std::string& scene, StudioJob& job) {
  const auto add = [&](const char* flag, const std::string& value) {
    job.words.insert(job.words.end(), {flag, value});
  };
  const std::vector<ScenePhoto> photos = photos_of_scene(project, scene);
  if (job.verb() == "train" && !project.left_out.empty() && write_chosen_list(project, photos))
    add("--set", "dataset.photo_list=photos.txt");
  if (names_masks(job.words)) return;
  if (const std::string masks = masks_for_job(project, scene, photos, job.id); !masks.empty())
    add("--masks", masks);
}

}  // namespace

fs::path own_masks_of(const Project& project) {
  if (!is_folder(project.input() / "masks")) return {};
  return project.photos.empty() ? fs::path("input") / "masks" : project.input() / "masks";
}

std::map<std::string, std::int64_t> painted_masks(const Project& project) {
  std::map<std::string, std::int64_t> times;
  const fs::path folder = project.folder / "masks";
  for (const std::string& file : picture_names_in(folder)) {
    std::error_code none;
    const auto time = fs::last_write_time(folder / file, none).time_since_epoch().count();
    times[without_extension(file)] = std::int64_t(time);
  }
  return times;
}

Image8 mask_as_seen(const Project& project, const std::string& photo, int degrees) {
  const fs::path file = mask_file(project, photo);
  if (!is_turn(degrees) || !is_file(file)) throw UsageError("this photo has no mask");
  return turned(upright(read_mask_file(file), orientation_of(project, photo)), degrees);
}

Image8 read_painted_mask(const Project& project, const std::string& photo, int degrees,
                         const std::string& png) {
  const std::vector<std::string> photos = photos_of(project);
  if (!is_turn(degrees) || !std::binary_search(photos.begin(), photos.end(), photo))
    throw UsageError("there is no such photo; load the page again");
  if (!own_masks_of(project).empty())
    throw UsageError("the photos have masks of their own; change these");
  const int orientation = orientation_of(project, photo);
  const PhotoSize stored = read_photo_size(photo_folder_of(project) / photo);
  const PhotoSize shown = turned_size(upright_size(stored, orientation), degrees);
  const Image8 seen = decoded(png, shown, mask_file(project, photo));
  if (hides_nothing(seen)) return {};
  return as_stored(turned(seen, (360 - degrees) % 360), orientation);
}

void keep_mask(const Project& project, const std::string& photo, const Image8& mask) {
  const fs::path file = mask_file(project, photo);
  if (!mask.empty())
    write_png(file, mask);
  else
    fs::remove(file);
}

std::string masks_for_job(const Project& project, const std::string& scene,
                          const std::vector<ScenePhoto>& photos, int job) {
  const bool is_own = is_own_scene(project, scene), is_absolute = fs::path(scene).is_absolute();
  const auto behind_flag = [&](const fs::path& folder) {
    return is_absolute || folder.is_absolute() ? (project.folder / folder).string()
                                               : (fs::path("..") / folder).generic_string();
  };
  if (const fs::path own = own_masks_of(project); !own.empty())
    return is_own ? "" : behind_flag(own);
  const auto painted = painted_masks(project);
  const auto turns = turns_of_scene(project, scene);
  std::vector<ScenePhoto> masked;
  for (const ScenePhoto& photo : photos)
    if (painted.contains(photo.photo)) masked.push_back(photo);
  if (masked.empty()) return "";
  if (std::ranges::any_of(photos, &ScenePhoto::has_own_mask))
    throw UsageError(
        "the scene's own file names masks, and others were painted; clear the painted ones");
  const std::string folder = fmt::format("masks-{}", job);
  fs::remove_all(project.folder / folder);
  parallel_for(masked.size(), 1, [&](std::size_t i) {
    const auto& [name, photo, none] = masked[i];
    const fs::path file = photo_folder_of(project) / photo;
    Image8 mask = with_alpha_of(file, read_mask_file(mask_file(project, photo)));
    if (!is_own) {
      const auto turn = turns.find(photo);
      mask = turned(upright(mask, orientation_of(project, photo)),
                    turn == turns.end() ? 0 : turn->second);
    }
    write_png(project.folder / folder / (name + ".png"), mask);
  });
  return behind_flag(folder);
}

void give_photos(const Project& project, StudioJob& job) {
  const std::string source = job.words.size() > 1 ? job.words[1] : "-";
  if (job.verb() == "reconstruct" && source == fmt::format("chosen-{}", job.id)) {
    choose_photos(project, job.id);
    job.turned = project.turned;
  }
  const bool has_masks = !own_masks_of(project).empty() || !painted_masks(project).empty();
  if (source.starts_with('-') || (!has_masks && project.left_out.empty())) return;
  if (job.verb() == "train") give_scene(project, source, job);
  if (job.verb() != "doctor" || !has_masks) return;
  try {
    if (!holds_only_photos(project.folder / source)) give_scene(project, source, job);
  } catch (const Error&) {  // which doctor finds, too, and explains
  }
}

}  // namespace gs
