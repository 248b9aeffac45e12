// SPDX-License-Identifier: Apache-2.0
// The operator beside its twin, the exact renderer, in every form of its arrays.
#include "gs_render/operator.h"

#include <cuda_runtime_api.h>

#include <utility>

#include "tests/support/cuda.h"
#include "tests/support/exact_inputs.h"

namespace gs {
namespace {

constexpr int kWidth = 70, kHeight = 45;  // several tiles, the last ones cut off
constexpr int kPixels = kWidth * kHeight;
constexpr int kCount = 100;          // more than three warps
constexpr double kTolerance = 2e-4;  // of norms; a fragment at its cutoff is 1/255

enum class Depth { none, metric, inverse };

/// Which arrays are given, and in which form.
struct Form {
  const char* name;
  InputShape shape;
  bool has_log_scales = true, has_logits = true;
  bool camera_on_device = false, background_on_device = false, one_sh_array = false;
  BlendRule rule = BlendRule::faster_gs;
  Depth depth = Depth::none;
  Lens lens = Lens::none;
};
constexpr Form kForms[] = {
    {.name = "as a model stores them", .shape = {3, 0, false, false}},
    {.name = "activated, with depths",
     .shape = {2, 0, false, true},
     .has_log_scales = false,
     .has_logits = false,
     .camera_on_device = true,
     .background_on_device = true,
     .depth = Depth::metric},
    {.name = "covariances",
     .shape = {1, 0, true, false},
     .has_log_scales = false,
     .camera_on_device = true},
    {.name = "colors, with inverse depths",
     .shape = {-1, 0, false, true},
     .has_logits = false,
     .background_on_device = true,
     .depth = Depth::inverse},
    {.name = "one array of SH",
     .shape = {3, 0, false, false},
     .has_log_scales = false,
     .has_logits = false,
     .camera_on_device = true,
     .background_on_device = true,
     .one_sh_array = true},
    {.name = "sh0 alone", .shape = {0, 0, false, false}},
    {.name = "colors of covariances by the classic rule, with depths",
     .shape = {-1, 0, true, false},
     .has_logits = false,
     .camera_on_device = true,
     .background_on_device = true,
     .rule = BlendRule::classic,
     .depth = Depth::metric},
    {.name = "through a fisheye, with depths",
     .shape = {2, 0, false, true},
     .camera_on_device = true,
     .depth = Depth::metric,
     .lens = Lens::fisheye},
    {.name = "parallel rays",
     .shape = {-1, 0, true, false},
     .camera_on_device = true,
     .lens = Lens::orthographic},
};

/// A stream, and memory of the GPU that the operator and the test itself take.
class TestMemory {
 public:
  TestMemory() {
    EXPECT_EQ(cudaStreamCreateWithFlags(&stream_, cudaStreamNonBlocking), cudaSuccess);
  }
  ~TestMemory() {
    for (void* const pointer : pointers_) cudaFree(pointer);
    cudaStreamDestroy(stream_);
  }
  TestMemory(const TestMemory&) = delete;
  TestMemory& operator=(const TestMemory&) = delete;
  cudaStream_t stream() const { return stream_; }
  void* allocate(std::size_t bytes) {
    void* pointer = nullptr;
    EXPECT_EQ(cudaMalloc(&pointer, bytes), cudaSuccess);
    EXPECT_EQ(cudaMemsetAsync(pointer, 0xff, bytes, stream_), cudaSuccess);  // NaN, unless written
    pointers_.push_back(pointer);
    return pointer;
  }
  float* floats(std::size_t count) { return static_cast<float*>(allocate(count * sizeof(float))); }
  float* uploaded(const std::vector<float>& values) {
    float* const to = floats(std::max<std::size_t>(values.size(), 1));
    copy(to, values.data(), values.size(), cudaMemcpyHostToDevice);
    return to;
  }
  AllocateOnDevice allocator() {
    return [this](std::size_t bytes) { return allocate(bytes); };
  }

  std::vector<float> downloaded(const float* from, std::size_t count) {
    std::vector<float> values(count);
    copy(values.data(), from, count, cudaMemcpyDeviceToHost);
    return values;
  }

 private:
  void copy(float* to, const float* from, std::size_t count, cudaMemcpyKind kind) {
    EXPECT_EQ(cudaMemcpyAsync(to, from, count * sizeof(float), kind, stream_), cudaSuccess);
    EXPECT_EQ(cudaStreamSynchronize(stream_), cudaSuccess);
  }

  cudaStream_t stream_ = nullptr;
  std::vector<void*> pointers_;
};

/// The numbers of vectors, one after the other.
template <class Vectors>
std::vector<float> flat(const Vectors& vectors) {
  std::vector<float> numbers;
  for (const auto& vector : vectors)
    for (const double number : scalars_of(vector)) numbers.push_back(float(number));
  return numbers;
}
std::vector<float> flat(const std::vector<double>& values) {
  return {values.begin(), values.end()};
}
std::vector<float> flat(const std::vector<Sym3<double>>& rows) {
  std::vector<float> numbers;
  for (const Sym3<double>& S : rows)
    for (const double number : {S.xx, S.xy, S.xz, S.yy, S.yz, S.zz})
      numbers.push_back(float(number));
  return numbers;
}
/// Planes from pixels: (H, W, 3) to (3, H, W).
std::vector<float> planes(const std::vector<Vec3d>& pixels) {
  std::vector<float> numbers;
  for (int c = 0; c < 3; ++c)
    for (const Vec3d& pixel : pixels) numbers.push_back(float(pixel[c]));
  return numbers;
}

/// Rounds to floats, so that both renderers see the same numbers.
double rounded(double x) { return double(float(x)); }
template <class V>
void round_all(std::vector<V>& vectors) {
  for (V& v : vectors) {
    if constexpr (std::is_same_v<V, double>)
      v = rounded(v);
    else if constexpr (std::is_same_v<V, Quat<double>>)
      v = {rounded(v.w), rounded(v.x), rounded(v.y), rounded(v.z)};
    else if constexpr (std::is_same_v<V, Sym3<double>>)
      v = {rounded(v.xx), rounded(v.xy), rounded(v.xz),
           rounded(v.yy), rounded(v.yz), rounded(v.zz)};
    else
      v = {rounded(v.x), rounded(v.y), rounded(v.z)};
  }
}
ExactInputs<double> in_floats(ExactInputs<double> in) {
  ExactGaussians<double>& g = in.gaussians;
  round_all(g.means), round_all(g.rotations), round_all(g.log_scales), round_all(g.covariances);
  round_all(g.opacities), round_all(g.colors), round_all(g.sh);
  in.view.camera = camera_as<double>(camera_as<float>(in.view.camera));
  in.view.background = Vec3d(Vec3f(in.view.background));
  for (Vec2<double>& offset : in.view.screen) offset = {rounded(offset.x), rounded(offset.y)};
  return in;
}

/// One problem in both renderers.
class Problem {
 public:
  Problem(const Form& form, int count, std::uint64_t seed) : form_(form) {
    TestRandom random(seed);
    in_ = draw_inputs(random, form.shape, count, kWidth, kHeight);
    in_.view.camera.lens.lens = form.lens;
    in_.view.camera.lens.radius = form.lens == Lens::fisheye ? 2 : 1e9;  // radians, and no limit
    in_.view.camera.lens.low = {-1e9, -1e9}, in_.view.camera.lens.high = {1e9, 1e9};
    in_ = in_floats(std::move(in_));
    dL_ = draw_picture_gradient(random, 0, kWidth, kHeight);
    (form.depth == Depth::metric ? dL_.inverse_depth : dL_.depth).clear();
    if (form.depth == Depth::none) dL_.inverse_depth.clear();
    round_all(dL_.image), round_all(dL_.alpha), round_all(dL_.depth), round_all(dL_.inverse_depth);
    settings_.blends_depth = form.depth != Depth::none;
    input_.has_inverse_depth = form.depth == Depth::inverse;
    exact_.splat.antialias = settings_.antialias = form.shape.antialias;
    exact_.splat.antialias_detach = settings_.antialias_detach = false;
    exact_.rule = settings_.blend_rule = form.rule;
    settings_.sh_degree = std::max(form.shape.sh_degree, 0);
    fill_input();
  }

  const ExactGaussians<double>& gaussians() const { return in_.gaussians; }
  RenderSettings& settings() { return settings_; }
  OperatorInput& input() { return input_; }

  TestMemory& memory() { return memory_; }
  std::unique_ptr<OperatorFrame> draw() {
    picture_ = {memory_.floats(3 * kPixels), memory_.floats(kPixels),
                settings_.blends_depth ? memory_.floats(kPixels) : nullptr};
    return cuda::splat_operator().draw(call(), input_, settings_, picture_);
  }
  // of the picture that was drawn last
  std::vector<float> image() { return memory_.downloaded(picture_.image, 3 * kPixels); }
  std::vector<float> alpha() { return memory_.downloaded(picture_.alpha, kPixels); }
  std::vector<float> depth() { return memory_.downloaded(picture_.depth, kPixels); }
  std::vector<float> drawn() {
    draw();
    return image();
  }

  /// Gradients by every array, by name; and "viewmat", "K", "screen".
  std::map<std::string, std::vector<float>> gradients(const OperatorFrame& frame,
                                                      bool with_image = true) {
    const std::size_t n = in_.gaussians.count(), coefficients = in_.gaussians.sh_count();
    std::map<std::string, std::pair<float*, std::size_t>> made;
    const auto make = [&](const char* name, std::size_t columns) {
      float* const to = memory_.floats(std::max<std::size_t>(n * columns, 1));
      made[name] = {to, n * columns};
      return OperatorRows<float>{to, columns};
    };
    OperatorGradients to;
    to.arrays.means = make("means", 3);
    to.arrays.opacities = make("opacities", 1);
    to.arrays.screen = make("screen", 2);
    if (form_.shape.has_covariances) {
      to.arrays.covariances = make("covariances", 6);
    } else {
      to.arrays.rotations = make("rotations", 4);
      to.arrays.scales = make("scales", 3);
    }
    if (form_.shape.sh_degree < 0) {
      to.arrays.colors = make("colors", 3);
    } else {
      const OperatorRows<float> sh = make("sh", 3 * coefficients);
      to.arrays.sh0 = sh;
      to.arrays.sh_rest = {sh.data + 3, sh.stride};
    }
    if (form_.camera_on_device) {
      to.viewmat = memory_.floats(16), made["viewmat"] = {to.viewmat, 16};
      to.K = memory_.floats(9), made["K"] = {to.K, 9};
    }
    cuda::splat_operator().pull_back(
        call(), frame, input_, settings_,
        {with_image ? memory_.uploaded(planes(dL_.image)) : nullptr,
         memory_.uploaded(flat(dL_.alpha)),
         form_.depth == Depth::none ? nullptr : memory_.uploaded(flat(depths_of(dL_)))},
        to);
    std::map<std::string, std::vector<float>> result;
    for (const auto& [name, array] : made)
      result[name] = memory_.downloaded(array.first, array.second);
    return result;
  }

  /// Depths or inverse depths, whichever are drawn.
  const std::vector<double>& depths_of(const ExactPicture<double>& picture) const {
    return form_.depth == Depth::metric ? picture.depth : picture.inverse_depth;
  }
  ExactPicture<double> exact_picture() const {
    return gs::exact_picture(in_.gaussians, in_.view, exact_);
  }
  std::map<std::string, std::vector<float>> exact_gradients() const {
    ExactGradients exact = gs::exact_gradients(in_.gaussians, in_.view, exact_, dL_);
    const ExactGaussians<double>& g = in_.gaussians;
    if (!form_.has_log_scales)
      for (std::size_t i = 0; i < exact.log_scales.size(); ++i)
        exact.log_scales[i] = exact.log_scales[i] / scale_of(i);
    if (form_.has_logits)
      for (std::size_t i = 0; i < g.count(); ++i)
        exact.opacities[i] *= g.opacities[i] * (1 - g.opacities[i]);
    std::map<std::string, std::vector<float>> result{{"means", flat(exact.means)},
                                                     {"opacities", flat(exact.opacities)},
                                                     {"screen", flat(exact.screen)}};
    if (form_.shape.has_covariances) {
      result["covariances"] = flat(exact.covariances);
    } else {
      result["rotations"] = flat(exact.rotations);
      result["scales"] = flat(exact.log_scales);
    }
    if (form_.shape.sh_degree < 0)
      result["colors"] = flat(exact.colors);
    else
      result["sh"] = flat(exact.sh);
    if (form_.camera_on_device) {
      const Mat3<double>& R = exact.camera.rotation;
      const Vec3d& t = exact.camera.translation;
      for (const auto& [row, shift] : {std::pair{R.row0, t.x}, {R.row1, t.y}, {R.row2, t.z}})
        for (const double number : {row.x, row.y, row.z, shift})
          result["viewmat"].push_back(float(number));
      result["viewmat"].resize(16, 0.0f);
      const CameraEntriesGradient<double>& K = exact.camera;
      result["K"] = {float(K.fx), 0, float(K.cx), 0, float(K.fy), float(K.cy), 0, 0, 0};
    }
    return result;
  }

 private:
  Vec3d scale_of(std::size_t i) const {
    const Vec3d& s = in_.gaussians.log_scales[i];
    return {std::exp(s.x), std::exp(s.y), std::exp(s.z)};
  }
  OperatorCall call() { return {0, memory_.stream(), memory_.allocator(), memory_.allocator()}; }
  OperatorRows<const float> rows(const std::vector<float>& numbers, std::size_t columns) {
    return {memory_.uploaded(numbers), columns};
  }

  void fill_input() {
    const ExactGaussians<double>& g = in_.gaussians;
    OperatorArrays<const float>& arrays = input_.arrays;
    input_.count = g.count();
    input_.has_log_scales = form_.has_log_scales;
    input_.has_logit_opacities = form_.has_logits;
    arrays.means = rows(flat(g.means), 3);
    std::vector<double> opacities = g.opacities;
    for (double& opacity : opacities) opacity = form_.has_logits ? logit(opacity) : opacity;
    arrays.opacities = rows(flat(opacities), 1);
    if (form_.shape.has_covariances) {
      arrays.covariances = rows(flat(g.covariances), 6);
    } else {
      arrays.rotations = rows(flat(g.rotations), 4);
      std::vector<Vec3d> scales = g.log_scales;
      for (std::size_t i = 0; !form_.has_log_scales && i < scales.size(); ++i)
        scales[i] = scale_of(i);
      arrays.scales = rows(flat(scales), 3);
    }
    if (form_.shape.sh_degree < 0) {
      arrays.colors = rows(flat(g.colors), 3);
    } else if (form_.one_sh_array) {
      arrays.sh0 = rows(flat(g.sh), 3 * g.sh_count());
      arrays.sh_rest = {arrays.sh0.data + 3, arrays.sh0.stride};
    } else {
      std::vector<Vec3d> sh0, rest;
      for (std::size_t k = 0; k < g.sh.size(); ++k)
        (k % g.sh_count() == 0 ? sh0 : rest).push_back(g.sh[k]);
      arrays.sh0 = rows(flat(sh0), 3);
      arrays.sh_rest = rows(flat(rest), 3 * (g.sh_count() - 1));
    }
    arrays.screen = rows(flat(in_.view.screen), 2);
    const PinholeCamera<double>& camera = in_.view.camera;
    if (form_.camera_on_device) {
      input_.camera.width = camera.width;
      input_.camera.height = camera.height;
      input_.camera.lens = lens_as<float>(camera.lens);
      const Mat3<double>& R = camera.cam_from_world_rotation;
      const Vec3d& t = camera.cam_from_world_translation;
      std::vector<float> viewmat;
      for (const auto& [row, shift] : {std::pair{R.row0, t.x}, {R.row1, t.y}, {R.row2, t.z}})
        for (const double number : {row.x, row.y, row.z, shift}) viewmat.push_back(float(number));
      for (const float number : {0.0f, 0.0f, 0.0f, 1.0f}) viewmat.push_back(number);
      input_.viewmat = memory_.uploaded(viewmat);
      input_.K = memory_.uploaded(
          {float(camera.fx), 0, float(camera.cx), 0, float(camera.fy), float(camera.cy), 0, 0, 1});
    } else {
      input_.camera = camera_as<float>(camera);
    }
    if (form_.background_on_device)
      settings_.background_on_device = memory_.uploaded(flat(std::vector{in_.view.background}));
    else
      settings_.background = Vec3f(in_.view.background);
  }

  Form form_;
  TestMemory memory_;
  ExactInputs<double> in_;
  ExactPicture<double> dL_;
  ExactSettings exact_;
  RenderSettings settings_;
  OperatorInput input_;
  OperatorPicture picture_;
};

class CudaOperator : public CudaTest {};

TEST_F(CudaOperator, PicturesAndGradientsAreTheExactOnesInEveryForm) {
  for (const Form& form : kForms) {
    SCOPED_TRACE(form.name);
    Problem problem(form, kCount, 3);
    const auto frame = problem.draw();
    const ExactPicture<double> exact = problem.exact_picture();
    EXPECT_LT(norm_difference(problem.image(), planes(exact.image)), 1e-5);
    EXPECT_LT(norm_difference(problem.alpha(), flat(exact.alpha)), 1e-5);
    if (form.depth != Depth::none) {
      EXPECT_LT(norm_difference(problem.depth(), flat(problem.depths_of(exact))), 1e-5);
    }
    const auto gradients = problem.gradients(*frame), expected = problem.exact_gradients();
    EXPECT_EQ(gradients.size(), expected.size());
    for (const auto& [name, values] : expected) {
      SCOPED_TRACE(name);
      EXPECT_LT(norm_difference(gradients.at(name), values), kTolerance);
    }
  }
}

TEST_F(CudaOperator, GradientsCanBeAskedForAgain) {
  Problem problem(kForms[1], kCount, 4);
  problem.settings().deterministic = true;
  const auto frame = problem.draw();
  const auto first = problem.gradients(*frame);
  EXPECT_EQ(problem.gradients(*frame), first);
  EXPECT_EQ(problem.gradients(*problem.draw()), first);
}

TEST_F(CudaOperator, ACopyOfWhatIsKeptHasTheSameGradients) {
  const SplatOperator& splats = cuda::splat_operator();
  for (const Form& form : kForms) {
    SCOPED_TRACE(form.name);
    Problem problem(form, kCount, 10);
    problem.settings().deterministic = true;
    problem.input().room = 1 << 16;
    const auto frame = problem.draw();
    const auto expected = problem.gradients(*frame);
    const std::size_t bytes = splats.kept_bytes(problem.input(), problem.settings());
    auto* const memory = static_cast<std::byte*>(problem.memory().allocate(bytes));
    const auto frame_in_memory = [&](const OperatorFrame* copied) {
      std::byte* next = memory;
      const OperatorCall call{0, problem.memory().stream(),
                              [&](std::size_t piece) { return std::exchange(next, next + piece); },
                              nullptr};
      auto made = splats.frame_in(call, problem.input(), problem.settings(), copied);
      EXPECT_EQ(next, memory + bytes);
      return made;
    };
    frame_in_memory(frame.get());
    EXPECT_EQ(problem.gradients(*frame_in_memory(nullptr)), expected);
  }
}

TEST_F(CudaOperator, ByAlphaAloneIsThatOfAnImageWithoutWeight) {
  Problem problem(kForms[0], kCount, 5);
  const auto frame = problem.draw();
  const auto gradients = problem.gradients(*frame, false);
  for (const float number : gradients.at("sh")) ASSERT_EQ(number, 0.0f);
  double sum = 0;
  for (const float number : gradients.at("opacities")) sum += std::abs(number);
  EXPECT_GT(sum, 0);
}

TEST_F(CudaOperator, OffsetsOnTheScreenMoveMeans) {
  Form form = kForms[3];
  Problem problem(form, kCount, 6);
  problem.input().arrays.screen = {problem.memory().uploaded(std::vector<float>(2 * kCount, 1.0f)),
                                   2};
  const std::vector<float> moved = problem.drawn();
  problem.input().arrays.screen = {};
  const std::vector<float> still = problem.drawn();
  double worst = 0;
  for (int c = 0; c < 3; ++c)
    for (int y = 1; y < kHeight; ++y)
      for (int x = 1; x < kWidth; ++x)
        worst = std::max(worst, std::abs(double(moved[(c * kHeight + y) * kWidth + x]) -
                                         still[(c * kHeight + y - 1) * kWidth + x - 1]));
  EXPECT_LT(worst, 1e-3);
}

TEST_F(CudaOperator, WithoutAGradientThePictureIsTheSame) {
  Problem problem(kForms[0], kCount, 7);
  const std::vector<float> expected = problem.drawn();
  problem.settings().for_backward = false;
  EXPECT_LT(norm_difference(problem.drawn(), expected), 1e-6);
}

TEST_F(CudaOperator, NothingToSeeShowsTheBackground) {
  for (const int count : {0, 5}) {
    Problem problem(kForms[1], count, 8);
    problem.settings().near_plane = 500, problem.settings().far_plane = 1000;
    const auto frame = problem.draw();
    EXPECT_EQ(frame->instances(), 0u);
    const std::vector<float> image = problem.image();
    for (int c = 0; c < 3; ++c)
      for (int i = 0; i < kPixels; ++i) ASSERT_EQ(image[c * kPixels + i], image[c * kPixels]);
    for (const auto& [name, gradient] : problem.gradients(*frame))
      for (const float number : gradient) ASSERT_EQ(number, 0.0f) << name;
  }
}

TEST_F(CudaOperator, MemoryThatRunsOutEndsTheCall) {
  Problem problem(kForms[0], kCount, 9);
  int left = 3;
  const OperatorCall call{
      0, nullptr, [](std::size_t) -> void* { throw Error("no memory", ExitCode::out_of_memory); },
      [&](std::size_t) -> void* { return --left, nullptr; }};
  EXPECT_THROW(cuda::splat_operator().draw(call, problem.input(), problem.settings(), {}), Error);
}

}  // namespace
}  // namespace gs
