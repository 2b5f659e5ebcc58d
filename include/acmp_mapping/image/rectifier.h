#pragma once

#include <mutex>
#include <utility>

#include <opencv2/core/mat.hpp>

#include "acmp_mapping/geometry/lens.h"
#include "acmp_mapping/image/image.h"
#include "acmp_mapping/image/label.h"
#include "acmp_mapping/image/mask.h"

namespace acmp {

/// Makes the image that a pinhole camera would have taken of that which one with a lens has taken. Several threads may
/// use it.
class Rectifier {
 public:
  /// Takes the distortion out: the pinhole camera is lens.Undistorted(). And what the camera moved while rows were read
  /// out: the image is that of the middle row's time.
  explicit Rectifier(const Lens& lens, const ReadoutMotion& readout = {})
      : Rectifier(lens, {"", lens.Undistorted()}, readout) {}
  Rectifier(const Lens& lens, PinholeFace face, const ReadoutMotion& readout = {})
      : lens_(lens), face_(std::move(face)), readout_(readout) {}

  const Lens& lens() const { return lens_; }
  const PinholeFace& face() const { return face_; }
  const ReadoutMotion& readout() const { return readout_; }

  /// Throws InvalidInputError unless an image of the lens' camera has this size.
  void CheckSize(int width, int height) const;

  /// Bilinear; black where the lens sees nothing. Throws InvalidInputError when the image (8-bit RGB) has not the size
  /// of the lens' camera. The first image of this size makes the maps: a camera alone, whatever size it claims, takes
  /// no memory.
  ColorImage Rectify(const cv::Mat& rgb) const;
  ColorImage Rectify(ColorImage image) const;

  /// The mask of the rectified image: it ignores what is made of a pixel that `mask` ignores, and what the lens does
  /// not see. Empty where everything is used. Throws as Rectify does.
  /// @param mask of the image as taken; empty: all of its pixels count
  Mask RectifyMask(const Mask& mask) const;

  /// Depth z of the rectified image: the nearest pixel's; 0 where there is none.
  /// @param depth of the image as taken, at any size; empty: gives an empty one. z, but distances from the camera's
  ///   centre where the image becomes faces: z says little there, and nothing from 90 degrees on
  DepthMap RectifyDepth(const DepthMap& depth) const;

  /// Labels of the rectified image: the nearest pixel's; unknown where the lens sees nothing. Throws as Rectify does.
  /// @param labels of the image as taken; empty: gives an empty one
  LabelImage RectifyLabels(const LabelImage& labels) const;

 private:
  bool ChangesNothing() const;
  int Border() const;
  /// Where a pixel comes from.
  struct Maps {
    cv::Mat x, y;  ///< fixed point, as cv::remap takes them
    Mask seen;     ///< ignores what the lens does not see; empty: it sees everything
  };
  const Maps& maps() const;
  Mask RemapMask(const Mask& mask, const Maps& maps) const;

  Lens lens_;
  PinholeFace face_;
  ReadoutMotion readout_;
  mutable std::once_flag made_;
  mutable Maps maps_;  ///< made at the first use
};

}  // namespace acmp
