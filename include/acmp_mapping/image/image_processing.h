#pragma once

#include <opencv2/core/mat.hpp>

#include "acmp_mapping/image/image.h"
#include "acmp_mapping/image/label.h"

namespace acmp {

/// Header over the same pixels (no copy): CV_32FC1.
cv::Mat AsMat(GrayImage& image);
/// Header over the same pixels (no copy): CV_8UC3 in RGB order.
cv::Mat AsMat(ColorImage& image);

/// Grey values in 0..255 as float, by OpenCV's RGB weights.
GrayImage ToGray(const ColorImage& color);

/// Area-averaged when shrinking, bilinear when enlarging; pixel u of the result sits at (u + 0.5) / s - 0.5.
ColorImage Resize(const ColorImage& image, int width, int height);
GrayImage Resize(const GrayImage& image, int width, int height);

/// Depth of an image at another size: the nearest pixel's, since between two surfaces there is none. What is not
/// positive and finite becomes 0, unknown.
DepthMap ResizeDepth(const DepthMap& depth, int width, int height);
/// The nearest pixel's, too.
LabelImage ResizeLabels(const LabelImage& labels, int width, int height);

}  // namespace acmp
