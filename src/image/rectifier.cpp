#include "acmp_mapping/image/rectifier.h"

#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <Eigen/Geometry>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <utility>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/image/image_processing.h"

namespace acmp {

void Rectifier::CheckSize(int width, int height) const {
  const PinholeCamera& c = lens_.camera();
  if (width == c.width && height == c.height) return;
  throw InvalidInputError(
      Concat("image size ", width, "x", height, ": that of its calibration is ", c.width, "x", c.height));
}

bool Rectifier::ChangesNothing() const {
  return lens_.distortion().model == LensDistortion::Model::kNone && face_.camera == lens_.camera() &&
         face_.lens_from_face.isIdentity() && readout_ == ReadoutMotion();
}

/// The last column of a sphere is beside the first.
int Rectifier::Border() const {
  const bool is_sphere = lens_.distortion().model == LensDistortion::Model::kEquirectangular;
  return is_sphere ? cv::BORDER_WRAP : cv::BORDER_CONSTANT;
}

const Rectifier::Maps& Rectifier::maps() const {
  std::call_once(made_, [this] {
    constexpr float kNowhere = -10;  // px: outside of every image, also when it is interpolated
    const PinholeCamera& face = face_.camera;
    cv::Mat x(face.height, face.width, CV_32FC1), y(face.height, face.width, CV_32FC1);
    // Wrapped as columns are, half a pixel beyond the zenith would be the nadir.
    const bool is_sphere = lens_.distortion().model == LensDistortion::Model::kEquirectangular;
    const double last_row = lens_.camera().height - 1;
    const auto fill_row = [&](int row) {
      const double time = (row + 0.5) / face.height - 0.5;  // of the readout, from its middle
      for (int col = 0; col < face.width; ++col) {
        Eigen::Vector3d ray = face.Unproject({static_cast<double>(col), static_cast<double>(row)});
        ray += time * (readout_.turn.cross(ray) - readout_.move);
        const auto seen = lens_.Project(face_.lens_from_face * ray);
        x.at<float>(row, col) = seen ? static_cast<float>(seen->x()) : kNowhere;
        y.at<float>(row, col) =
            seen ? static_cast<float>(is_sphere ? std::clamp(seen->y(), 0.0, last_row) : seen->y()) : kNowhere;
      }
    };
    // Isolated: this thread must take no other task meanwhile, which might wait for these maps.
    tbb::this_task_arena::isolate([&] { tbb::parallel_for(0, face.height, fill_row); });
    cv::convertMaps(x, y, maps_.x, maps_.y, CV_16SC2);
    Mask shown(lens_.camera().width, lens_.camera().height);
    for (int row = 0; row < shown.height(); ++row) {
      for (int col = 0; col < shown.width(); ++col) {
        shown(col, row) = lens_.Shows({static_cast<double>(col), static_cast<double>(row)}) ? 255 : 0;
      }
    }
    Mask seen = RemapMask(shown, maps_);
    if (IgnoresSome(seen)) maps_.seen = std::move(seen);
  });
  return maps_;
}

ColorImage Rectifier::Rectify(const cv::Mat& rgb) const {
  CheckSize(rgb.cols, rgb.rows);
  ColorImage rectified(face_.camera.width, face_.camera.height);
  cv::Mat target = AsMat(rectified);
  if (ChangesNothing()) {
    rgb.copyTo(target);
  } else {
    cv::remap(rgb, target, maps().x, maps().y, cv::INTER_LINEAR, Border());
  }
  return rectified;
}

ColorImage Rectifier::Rectify(ColorImage image) const {
  CheckSize(image.width(), image.height());
  return ChangesNothing() ? std::move(image) : Rectify(AsMat(image));
}

Mask Rectifier::RectifyMask(const Mask& mask) const {
  if (!mask.empty()) CheckSize(mask.width(), mask.height());
  Mask rectified;
  if (ChangesNothing()) {
    rectified = mask.Clone();
  } else if (mask.empty()) {
    rectified = maps().seen.Clone();
  } else {
    rectified = IntersectMasks(RemapMask(mask, maps()), maps().seen);
  }
  return IgnoresSome(rectified) ? std::move(rectified) : Mask();
}

Mask Rectifier::RemapMask(const Mask& mask, const Maps& maps) const {
  Mask used(mask.width(), mask.height()), result(face_.camera.width, face_.camera.height);
  std::transform(mask.begin(), mask.end(), used.begin(), [](unsigned char value) { return value != 0 ? 255 : 0; });
  cv::Mat target(result.height(), result.width(), CV_8U, result.data());
  cv::remap(cv::Mat(used.height(), used.width(), CV_8U, used.data()), target, maps.x, maps.y, cv::INTER_LINEAR,
            Border());
  // What is interpolated with a pixel that is ignored is less than 255.
  for (unsigned char& value : result) value = value == 255 ? 255 : 0;
  return result;
}

LabelImage Rectifier::RectifyLabels(const LabelImage& labels) const {
  if (labels.empty()) return {};
  CheckSize(labels.width(), labels.height());
  if (ChangesNothing()) return labels.Clone();
  LabelImage rectified(face_.camera.width, face_.camera.height);
  const cv::Mat taken(labels.height(), labels.width(), CV_8U, const_cast<Label*>(labels.data()));
  cv::Mat target(rectified.height(), rectified.width(), CV_8U, rectified.data());
  cv::remap(taken, target, maps().x, maps().y, cv::INTER_NEAREST, Border());
  return rectified;
}

DepthMap Rectifier::RectifyDepth(const DepthMap& depth) const {
  if (depth.empty()) return {};
  DepthMap taken = ResizeDepth(depth, lens_.camera().width, lens_.camera().height);
  if (ChangesNothing()) return taken;
  DepthMap rectified(face_.camera.width, face_.camera.height);
  cv::Mat target = AsMat(rectified);
  // As interpolation would invent depths at edges.
  cv::remap(AsMat(taken), target, maps().x, maps().y, cv::INTER_NEAREST, Border());
  if (face_.camera == lens_.Undistorted()) return rectified;
  for (int row = 0; row < rectified.height(); ++row) {
    for (int col = 0; col < rectified.width(); ++col) {
      const Eigen::Vector3d ray = face_.camera.Unproject({static_cast<double>(col), static_cast<double>(row)});
      rectified(col, row) /= static_cast<float>(ray.norm());  // z of the ray is 1
    }
  }
  return rectified;
}

}  // namespace acmp
