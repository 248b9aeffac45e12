// SPDX-License-Identifier: Apache-2.0
// The second half of `gemsplat selftest`: every stage of a GPU against the scalar backend.
#include <algorithm>
#include <array>
#include <set>

#include "gs_app/checks/generated_scene.h"
#include "gs_app/checks/self_check_list.h"
#include "gs_app/checks/untrained.h"
#include "gs_train/opened_moments.h"
#include "gs_train/schedule.h"

namespace gs {
namespace {

// exp, log and the order of sums differ in the last bits, and a fragment or a tile at its threshold
// may be kept by one backend and dropped by the other. The tolerances are several times the
// differences that an H200 shows.
constexpr double kSplatTolerance = 1e-4;
constexpr double kConicTolerance = 1e-3;  // the determinant of a thin splat cancels
constexpr double kTileTolerance = 5e-3;   // share of the instances that differ
constexpr double kPictureTolerance = 1e-3;
constexpr double kLossTolerance = 1e-3;
constexpr double kGradientTolerance = 5e-3;
constexpr double kStepTolerance = 2e-2;  // Adam divides tiny gradients by their own size
// Of half moments: one that is rounded the other way differs by an eighth of m, or a quarter of v.
constexpr double kHalfTolerance = 0.1;
// So that the moments are like those in the middle of a run.
constexpr int kStepsBefore = 20;
constexpr LossSettings kLossSettings{.lambda_dssim = 0.2f};
constexpr float kDeadLogit = -8;  // of an opacity of 0.0003
constexpr std::size_t kPhotoBytes = std::size_t(1) << 28;

struct ParityScene {
  std::string name;
  SceneRecipe recipe;
  RenderSettings settings;
};

std::vector<ParityScene> parity_scenes() {
  std::vector<ParityScene> scenes;
  const auto add = [&](const char* name, int width, int height, int degree) -> ParityScene& {
    SceneRecipe recipe{.gaussians = 3000, .width = width, .height = height, .views = 3};
    recipe.seed = scenes.size() + 1;
    scenes.push_back({name, recipe, {}});
    scenes.back().settings.sh_degree = degree;
    return scenes.back();
  };
  add("faster_gs", 160, 120, 3);
  add("degree 2, odd size", 131, 77, 2).settings.background = {0.3f, 0.6f, 0.9f};
  add("classic, degree 1", 97, 113, 1).settings.blend_rule = BlendRule::classic;
  add("antialias, degree 0", 160, 96, 0).settings.antialias = true;
  add("in space and time, degree 1", 131, 77, 1).recipe.moves = true;
  ParityScene& opaque = add("classic, antialias, opaque", 75, 50, 3);
  opaque.settings.blend_rule = BlendRule::classic;
  opaque.settings.antialias = true;
  opaque.settings.antialias_detach = false;
  opaque.recipe.opacity_low = 0.9f;
  opaque.recipe.opacity_high = 0.999f;
  return scenes;
}

/// Compares the two backends on one generated scene, stage after stage.
class ParityCheck {
 public:
  ParityCheck(const ParityScene& scene, Backend& cpu, Backend& device, SelfCheckList& checks)
      : name_(scene.name), settings_(scene.settings), scene_(generated_scene(scene.recipe)),
        view_(scene_.views[0]), cpu_(cpu), device_(device), checks_(checks),
        on_device_(copy_to(device.memory(), scene_.model)), device_pass_(device.memory()) {}

  void run() {
    cpu_.renderer().forward(on_host().span(), view_.camera, settings_, cpu_pass_);
    device_.renderer().forward(on_device_.span(), view_.camera, settings_, device_pass_);
    compare_splats();
    compare_tile_lists();
    compare("image", kPictureTolerance, device_pass_.image, cpu_pass_.image);
    compare("transmittance", kPictureTolerance, device_pass_.transmittance,
            cpu_pass_.transmittance);
    device_.device().upload_views(scene_.views, kPhotoBytes);
    compare_loss();
    compare_gradients();
    compare_step("step", {.gather_statistics = true});
    compare_step("step on a reduced photo", {.gather_statistics = true}, 2);
    compare_step("mcmc step", {.regularizers = {0.01f, 0.01f},  // those of the preset mcmc
                               .noise = {kNoiseScale, {1, RandomStream::position_noise}, 1}});
    compare_step_with_half_moments("step with half moments: ");
    compare_relocation();
    device_.device().upload_views({}, 0);  // this scene's views end here
  }

 private:
  const Gaussians& on_host() const { return scene_.model.gaussians; }

  void compare(const std::string& what, double tolerance, const Numbers& actual,
               const Numbers& expected) {
    checks_.add(what, name_, tolerance, actual, expected);
  }
  template <class T>
  void compare(const std::string& what, double tolerance, const Buffer<T>& actual,
               const Buffer<T>& expected) {
    compare(what, tolerance, downloaded_numbers(actual), downloaded_numbers(expected));
  }

  // Compares splats that both backends see. compare_tile_lists() finds those that only one sees.
  void compare_splats() {
    const auto cpu_counts = cpu_pass_.tile_counts.download();
    const auto device_counts = device_pass_.tile_counts.download();
    std::array<Numbers, 2> depth, mean, conic, opacity, color;
    const auto collect = [&](std::size_t side, const RenderPass& pass) {
      const std::vector<Splat> splats = pass.splats.download();
      for (std::size_t i = 0; i < splats.size(); ++i) {
        if (!cpu_counts[i] || !device_counts[i]) continue;
        const Splat& s = splats[i];
        depth[side].push_back(s.depth);
        mean[side].insert(mean[side].end(), {s.mean2d.x, s.mean2d.y});
        conic[side].insert(conic[side].end(), {s.conic.xx, s.conic.xy, s.conic.yy});
        opacity[side].push_back(s.opacity);
        color[side].insert(color[side].end(), {s.color.x, s.color.y, s.color.z});
      }
    };
    collect(0, device_pass_);
    collect(1, cpu_pass_);
    compare("splats: depth", kSplatTolerance, depth[0], depth[1]);
    compare("splats: mean2d", kSplatTolerance, mean[0], mean[1]);
    compare("splats: conic", kConicTolerance, conic[0], conic[1]);
    compare("splats: opacity", kConicTolerance, opacity[0], opacity[1]);
    compare("splats: color", kSplatTolerance, color[0], color[1]);
  }

  using TileList = std::vector<std::uint32_t>;  // Gaussians, front to back
  static std::vector<TileList> tile_lists(const RenderPass& pass) {
    TileList ranges = pass.tile_ranges.download(), splats = pass.tile_splats.download();
    for (std::uint32_t& splat : splats) splat = gaussian_of(splat);
    std::vector<TileList> lists(pass.tile_count());
    for (std::size_t tile = 0; tile < lists.size(); ++tile)
      lists[tile].assign(splats.begin() + ranges[tile], splats.begin() + ranges[tile + 1]);
    return lists;
  }
  /// The entries of `list` that `other` has, too, in their order.
  static TileList shared(const TileList& list, const TileList& other) {
    const std::set<std::uint32_t> wanted(other.begin(), other.end());
    TileList result;
    for (const std::uint32_t gaussian : list)
      if (wanted.contains(gaussian)) result.push_back(gaussian);
    return result;
  }
  /// The number of instances that only one list has or that are in another order.
  static std::size_t differing(const TileList& a, const TileList& b) {
    const TileList in_a = shared(a, b), in_b = shared(b, a);
    std::size_t result = a.size() + b.size() - in_a.size() - in_b.size();
    for (std::size_t i = 0; i < in_a.size(); ++i) result += in_a[i] != in_b[i];
    return result;
  }
  void compare_tile_lists() {
    const auto actual = tile_lists(device_pass_), expected = tile_lists(cpu_pass_);
    std::size_t instances = 0, differ = 0, most = 0;
    for (std::size_t tile = 0; tile < expected.size(); ++tile) {
      const std::size_t here = differing(actual[tile], expected[tile]);
      instances += expected[tile].size();
      differ += here;
      most = std::max(most, here);
    }
    checks_.add("tile lists", name_, kTileTolerance, instances, double(most),
                double(differ) / std::max(double(instances), 1.0));
  }

  void compare_loss() {
    compare_loss_of(view_, "loss");
    View masked = view_;
    masked.mask = Image8(cpu_pass_.width, cpu_pass_.height, 1, 255);
    std::fill_n(masked.mask.pixels.begin(), masked.mask.pixels.size() / 3, std::uint8_t(0));
    masked.exposure = {0.9f, 1.0f, 1.1f};
    compare_loss_of(masked, "masked loss");
  }
  // Both backends get the CPU's picture.
  void compare_loss_of(const View& view, const std::string& what) {
    RenderPass pass(device_.memory());
    pass.width = cpu_pass_.width;
    pass.height = cpu_pass_.height;
    pass.image.upload(cpu_pass_.image.download());
    Buffer<float> cpu_dL, device_dL(device_.memory());
    cpu_.loss().forward_backward(cpu_pass_, view, kLossSettings, cpu_dL);
    device_.loss().forward_backward(pass, view, kLossSettings, device_dL);
    compare_loss_values(what);
    compare(what + ": dL_dimage", kLossTolerance, device_dL, cpu_dL);
  }
  void compare_loss_values(const std::string& what) {
    compare(what, kLossTolerance, Numbers{float(device_.loss().value())},
            Numbers{float(cpu_.loss().value())});
  }

  void compare_gradients() {
    const Numbers dL_dimage = random_normals(cpu_pass_.image.size(), 99);
    const std::size_t count = on_host().count();
    Buffer<float> cpu_dL, device_dL(device_.memory());
    cpu_dL.upload(dL_dimage);
    device_dL.upload(dL_dimage);
    Gaussians expected = rows_like(on_host(), count, host_memory()),
              actual = rows_like(on_host(), count, device_.memory());
    Buffer<Vec2f> expected_mean2d(count, host_memory()), mean2d(count, device_.memory());
    cpu_.renderer().backward(on_host().span(), view_.camera, settings_, cpu_pass_, cpu_dL.span(),
                             expected.span(), expected_mean2d.span());
    device_.renderer().backward(on_device_.span(), view_.camera, settings_, device_pass_,
                                device_dL.span(), actual.span(), mean2d.span());
    compare("gradient: mean2d", kGradientTolerance, mean2d, expected_mean2d);
    for_each_array(
        [&](const char* name, const auto& a, const auto& b) {
          compare(std::string("gradient: ") + name, kGradientTolerance, a, b);
        },
        actual, expected);
  }

  void step(Backend& backend, TrainingModel& model, const DensityStep& density, int index,
            int reduction = 1) {
    const TrainingPhoto photo{&scene_.views[std::size_t(index) % scene_.views.size()], settings_,
                              reduction};
    backend.step(model,
                 {{&photo, 1}, kLossSettings, {Schedule(Config{}, 1).learning_rates(1)}, density});
    backend.synchronize(model);
  }
  // A model after some steps on the CPU.
  TrainingModel under_way(const DensityStep& density,
                          MomentStorage moments = MomentStorage::floats) {
    TrainingModel model = untrained(scene_.model, host_memory(), moments);
    for (int i = 0; i < kStepsBefore; ++i) step(cpu_, model, density, i);
    return model;
  }

  // Compares the changes of one more step.
  void compare_step(const std::string& what, const DensityStep& density, int reduction = 1) {
    TrainingModel expected = under_way(density);
    const TrainingModel before = copy_to(host_memory(), expected);
    TrainingModel actual = copy_to(device_.memory(), expected);
    step(cpu_, expected, density, kStepsBefore, reduction);
    step(device_, actual, density, kStepsBefore, reduction);
    compare_changes(what + ": ", before, actual, expected);
    compare_loss_values("loss");
  }
  // A code moves by more when it is rounded than a step changes it, so of moments the values are
  // compared, and not their changes.
  void compare_step_with_half_moments(const std::string& what) {
    constexpr DensityStep kGathering{.gather_statistics = true};
    TrainingModel expected = under_way(kGathering, MomentStorage::halves);
    TrainingModel before = copy_to(host_memory(), expected);
    clear_moments(before, MomentClearing::all);
    TrainingModel actual = copy_to(device_.memory(), expected);
    step(cpu_, expected, kGathering, kStepsBefore);
    step(device_, actual, kGathering, kStepsBefore);
    compare_changes(what, before, actual, expected, kHalfTolerance);
  }
  // A fifth of the Gaussians is dead, and the number of Gaussians grows by a tenth.
  void compare_relocation() {
    TrainingModel expected = under_way({.gather_statistics = true});
    const std::size_t count = expected.count();
    for (std::size_t i = 0; i < count; i += 5) expected.gaussians.logit_opacity[i] = kDeadLogit;
    TrainingModel actual = copy_to(device_.memory(), expected);
    const RelocationRules rules{DensityConfig{}.prune_opacity, std::int64_t(count + count / 10)};
    const RefineReport wanted = cpu_.rows().relocate(expected, rules, 1, 1);
    const RefineReport report = device_.rows().relocate(actual, rules, 1, 1);
    compare("relocation: counts", 0, Numbers{float(report.moved), float(report.cloned)},
            Numbers{float(wanted.moved), float(wanted.cloned)});
    const auto compare_all = [&](const Gaussians& a, const Gaussians& b, const std::string& what) {
      for_each_array(
          [&](const char* name, const auto& x, const auto& y) {
            compare("relocation: " + (what.empty() ? name : what), kGradientTolerance, x, y);
          },
          a, b);
    };
    compare_all(actual.gaussians, expected.gaussians, "");
    const OpenedMoments a = opened(actual), b = opened(expected);
    compare_all(a.first, b.first, "first moments");
    compare_all(a.second, b.second, "second moments");
    compare("relocation: visits", 0, actual.statistics.visits, expected.statistics.visits);
  }
  void compare_changes(const std::string& step, const TrainingModel& before,
                       const TrainingModel& actual, const TrainingModel& expected,
                       double of_moments = kStepTolerance) {
    const auto compare_change = [&](const std::string& what, const auto& old, const auto& a,
                                    const auto& b, double tolerance = kStepTolerance) {
      Numbers change = downloaded_numbers(a), expected_change = downloaded_numbers(b);
      const Numbers start = downloaded_numbers(old);
      for (std::size_t i = 0; i < start.size(); ++i) {
        change[i] -= start[i];
        expected_change[i] -= start[i];
      }
      compare(what, tolerance, change, expected_change);
    };
    for_each_array([&](const char* name, const auto& old, const auto& a,
                       const auto& b) { compare_change(step + name, old, a, b); },
                   before.gaussians, actual.gaussians, expected.gaussians);
    const auto compare_all = [&](const std::string& what, const Gaussians& old, const Gaussians& a,
                                 const Gaussians& b) {
      for_each_array([&](const char*, const auto& x, const auto& y,
                         const auto& z) { compare_change(what, x, y, z, of_moments); },
                     old, a, b);
    };
    const OpenedMoments old = opened(before), a = opened(actual), b = opened(expected);
    compare_all(step + "first moments", old.first, a.first, b.first);
    compare_all(step + "second moments", old.second, a.second, b.second);
    compare_change(step + "visits", before.statistics.visits, actual.statistics.visits,
                   expected.statistics.visits);
    compare_change(step + "gradient norms", before.statistics.gradient_norm,
                   actual.statistics.gradient_norm, expected.statistics.gradient_norm);
  }

  std::string name_;
  RenderSettings settings_;
  GeneratedScene scene_;
  const View& view_;
  Backend& cpu_;
  Backend& device_;
  SelfCheckList& checks_;
  Gaussians on_device_;
  RenderPass cpu_pass_, device_pass_;
};

}  // namespace

std::vector<SelfCheck> parity_checks(Backend& device) {
  const std::unique_ptr<Backend> cpu = make_scalar_backend();
  SelfCheckList checks;
  for (const ParityScene& scene : parity_scenes()) ParityCheck(scene, *cpu, device, checks).run();
  return checks.take();
}

}  // namespace gs
