// SPDX-License-Identifier: Apache-2.0
// Stage 5 for surfaces: the gradient of their losses by what stage 4 has blended. Twin of
// gs_train/stages/surface_loss.cpp.
#include "cuda/photo_terms/surface.cuh"

#include "cuda/stages.cuh"

namespace gs::cuda {
namespace {

constexpr int kPixelThreads = 256;  // pixels are independent
constexpr int kPatchThreads = 64;   // a thread walks over a patch; there are few of them

__global__ void __launch_bounds__(kPixelThreads)
    gray_kernel(PhotoBytes photo, std::uint32_t count, float* gray) {
  const std::uint32_t i = blockIdx.x * kPixelThreads + threadIdx.x;
  if (i < count)
    gray[i] = gray_of(photo.photo + 3 * std::size_t(i), photo.mask ? photo.mask + i : nullptr);
}

// A pixel of a picture for each thread.
struct PictureThread {
  int x, y;
  std::size_t i;

  __device__ explicit PictureThread(const Camera& camera) {
    i = std::size_t(blockIdx.x) * kPixelThreads + threadIdx.x;
    x = int(i % std::size_t(camera.width));
    y = int(i / std::size_t(camera.width));
  }
};

__global__ void __launch_bounds__(kPixelThreads)
    inverse_depth_kernel(const __grid_constant__ SurfacePicture picture, float* inverse_depth) {
  const PictureThread at(picture.camera);
  if (at.y < picture.camera.height)
    inverse_depth[at.i] =
        mean_inverse_depth(picture.sums[at.i], from_axis(picture.camera, at.x, at.y));
}

__global__ void __launch_bounds__(kPixelThreads)
    compare_normals_kernel(const __grid_constant__ SurfacePicture picture,
                           PixelSurface<float>* dL) {
  const PictureThread at(picture.camera);
  if (at.y < picture.camera.height) picture.compare_normals(at.x, at.y, dL[at.i]);
}

__global__ void __launch_bounds__(kPatchThreads)
    compare_photos_kernel(const __grid_constant__ SurfacePicture picture, PixelSurface<float>* dL) {
  const int patch = int(blockIdx.x * kPatchThreads + threadIdx.x);
  if (patch < picture.patches_across() * picture.patches_down()) picture.compare_photos(patch, dL);
}

__global__ void __launch_bounds__(kPixelThreads)
    surface_gradient_kernel(const __grid_constant__ SurfacePicture picture,
                            const PixelSurface<float>* dL, SurfaceRow* to) {
  const PictureThread at(picture.camera);
  if (at.y < picture.camera.height) to[at.i] = picture.gradient(at.x, at.y, dL);
}

std::size_t pixels_of(const Camera& camera) { return std::size_t(camera.width) * camera.height; }

void make_gray(Context& context, const Camera& camera, const PhotoBytes& photo,
               Buffer<float>& gray) {
  const std::size_t count = pixels_of(camera);
  gray.resize_discard(count);
  context.launch("gray photo", gray_kernel, blocks_for(count, kPixelThreads), kPixelThreads, photo,
                 std::uint32_t(count), gray.data());
}

}  // namespace

void SurfaceStage::take_photo(Context& context, const Camera& camera, const PhotoBytes& photo) {
  const StageScope scope(context, "surface loss");
  make_gray(context, camera, photo, gray_);
}
void SurfaceStage::take_neighbor(Context& context, const Camera& camera, const PhotoBytes& photo) {
  const StageScope scope(context, "surface loss");
  make_gray(context, camera, photo, other_gray_);
}

Span<const SurfaceRow> SurfaceStage::compare(Context& context, const Camera& camera,
                                             const NormalMap& prior, const Camera* neighbor,
                                             const SurfaceWeights& weights, int patch_phase,
                                             const RenderPass& pass) {
  const StageScope scope(context, "surface loss");
  const std::size_t pixels = pixels_of(camera);
  GS_CHECK(pass.surface_image.size() == pixels && gray_.size() == pixels);
  inverse_depth_.resize_discard(pixels);
  surfaces_.resize_discard(pixels);
  gradient_.resize_discard(pixels);
  SurfacePicture picture{camera,
                         pass.surface_image.data(),
                         inverse_depth_.data(),
                         {gray_.data(), camera.width, camera.height},
                         weights_of_each(weights, camera),
                         prior};
  const unsigned blocks = blocks_for(pixels, kPixelThreads);
  context.launch("inverse depth", inverse_depth_kernel, blocks, kPixelThreads, picture,
                 inverse_depth_.data());
  context.launch("normal loss", compare_normals_kernel, blocks, kPixelThreads, picture,
                 surfaces_.data());
  if (neighbor && weights.photo > 0) {
    GS_CHECK(other_gray_.size() == pixels_of(*neighbor));
    picture.neighbor = seen_from(camera, *neighbor);
    picture.other = {other_gray_.data(), neighbor->width, neighbor->height};
    picture.phase = patch_phase;
    const std::size_t patches = std::size_t(picture.patches_across()) * picture.patches_down();
    context.launch("photo loss", compare_photos_kernel, blocks_for(patches, kPatchThreads),
                   kPatchThreads, picture, surfaces_.data());
  }
  context.launch("surface gradient", surface_gradient_kernel, blocks, kPixelThreads, picture,
                 surfaces_.data(), gradient_.data());
  return gradient_.span();
}

void SurfaceStage::release() {
  for (ByteBuffer* const buffer : std::initializer_list<ByteBuffer*>{
           &inverse_depth_, &gray_, &other_gray_, &surfaces_, &gradient_})
    buffer->release();
}

}  // namespace gs::cuda
