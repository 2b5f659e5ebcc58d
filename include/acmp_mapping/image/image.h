#pragma once

#include <algorithm>
#include <cstddef>
#include <limits>
#include <type_traits>
#include <utility>
#include <vector>

#include "acmp_mapping/common/host_device.h"
#include "acmp_mapping/common/vector_math.h"
#include "acmp_mapping/geometry/plane_hypothesis.h"

namespace acmp {

/// Pixels of somebody else, rows `stride` elements apart. Trivially copyable, so kernels take it by value.
template <class T>
struct ImageView {
  T* data = nullptr;
  int width = 0;   ///< px
  int height = 0;  ///< px
  int stride = 0;  ///< elements from row to row

  ACMP_HOST_DEVICE T& operator()(int col, int row) const { return data[static_cast<size_t>(row) * stride + col]; }
  ACMP_HOST_DEVICE bool Contains(int col, int row) const { return col >= 0 && row >= 0 && col < width && row < height; }
  ACMP_HOST_DEVICE bool empty() const { return width == 0 || height == 0; }

  /// A view for reading; constrained so that views of const elements do not convert to themselves.
  template <class U = T, class = std::enable_if_t<!std::is_const<U>::value>>
  ACMP_HOST_DEVICE operator ImageView<const U>() const {  // NOLINT(google-explicit-constructor): as T* to const T*
    return {data, width, height, stride};
  }
};

/// Owns width x height pixels, row-major and without padding. Copies are explicit (Clone).
template <class T>
class Image {
 public:
  Image() = default;
  Image(int width, int height, const T& value = T())
      : width_(width), height_(height), pixels_(static_cast<size_t>(width) * height, value) {}
  Image(Image&& other) noexcept { *this = std::move(other); }
  Image& operator=(Image&& other) noexcept {
    width_ = std::exchange(other.width_, 0);
    height_ = std::exchange(other.height_, 0);
    pixels_ = std::exchange(other.pixels_, {});
    return *this;
  }
  Image(const Image&) = delete;
  Image& operator=(const Image&) = delete;

  Image Clone() const {
    Image copy;
    copy.width_ = width_;
    copy.height_ = height_;
    copy.pixels_ = pixels_;
    return copy;
  }

  int width() const { return width_; }
  int height() const { return height_; }
  size_t size() const { return pixels_.size(); }
  bool empty() const { return pixels_.empty(); }
  T* data() { return pixels_.data(); }
  const T* data() const { return pixels_.data(); }
  T& operator()(int col, int row) { return pixels_[static_cast<size_t>(row) * width_ + col]; }
  const T& operator()(int col, int row) const { return pixels_[static_cast<size_t>(row) * width_ + col]; }

  ImageView<T> View() { return {data(), width_, height_, width_}; }
  ImageView<const T> View() const { return {data(), width_, height_, width_}; }
  // NOLINTNEXTLINE(google-explicit-constructor): as string to string_view
  operator ImageView<const T>() const { return View(); }

  auto begin() { return pixels_.begin(); }
  auto end() { return pixels_.end(); }
  auto begin() const { return pixels_.begin(); }
  auto end() const { return pixels_.end(); }

 private:
  int width_ = 0;
  int height_ = 0;
  std::vector<T> pixels_;
};

/// The view's pixels, without its padding.
template <class T>
Image<std::remove_const_t<T>> Clone(const ImageView<T>& view) {
  Image<std::remove_const_t<T>> image(view.width, view.height);
  for (int row = 0; row < view.height; ++row) std::copy_n(&view(0, row), view.width, &image(0, row));
  return image;
}

struct Rgb {
  unsigned char r = 0, g = 0, b = 0;
};

/// Sum of the absolute differences of red, green and blue, 0..765.
ACMP_HOST_DEVICE inline int ColorDistance(const Rgb& a, const Rgb& b) {
  const int red = a.r - b.r, green = a.g - b.g, blue = a.b - b.b;
  return (red < 0 ? -red : red) + (green < 0 ? -green : green) + (blue < 0 ? -blue : blue);
}

using GrayImage = Image<float>;  ///< grey values 0..255
using ColorImage = Image<Rgb>;
using DepthMap = Image<float>;   ///< z in scene units; 0 = unknown; never NaN
using NormalMap = Image<Vec3f>;  ///< unit normals in the camera frame, facing the camera; 0 = unknown
using CostMap = Image<float>;    ///< matching cost, 0 (perfect) to kWorstCost (plus the geometric term), or one below
constexpr float kWorstCost = 2.0f;  ///< in a CostMap: NCC = -1, or no correspondence at all
/// In a CostMap: a filled depth in place of one that a single view had confirmed, or one from the weighted median. It
/// was never matched, but other views may confirm it.
constexpr float kUnverifiedCost = 1.9999999f;
/// In a CostMap: an unsupported depth, which would hide what other images show (RemoveUnsupported). It makes no point.
constexpr float kUnsupportedCost = std::numeric_limits<float>::infinity();
using ConfidenceMap = Image<float>;       ///< 0..1; 0 = unknown
using PlaneMap = Image<PlaneHypothesis>;  ///< planes in the camera frame; all zero = none

}  // namespace acmp
