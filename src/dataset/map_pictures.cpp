#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "acmp_mapping/dataset/map_io.h"
#include "acmp_mapping/image/image_processing.h"

namespace acmp {
namespace {

constexpr double kLowQuantile = 0.02;
constexpr double kHighQuantile = 0.98;

float Quantile(std::vector<float>* values, double share) {
  const auto nth = values->begin() + static_cast<ptrdiff_t>(std::lround(share * (values->size() - 1)));
  std::nth_element(values->begin(), nth, values->end());
  return *nth;
}

/// Colours the finite values of `map` from `low` (dark) to `high` (light); others are black. Viridis: perceptually
/// uniform, readable by colour-blind people and in print, and its dark end is not black.
ColorImage Colorize(const Image<float>& map, float low, float high) {
  const float scale = high > low ? 255.0f / (high - low) : 0.0f;
  cv::Mat levels(map.height(), map.width(), CV_8U);
  std::transform(map.begin(), map.end(), levels.begin<unsigned char>(), [&](float value) -> unsigned char {
    return std::isfinite(value) ? std::lround(Clamp((value - low) * scale, 0.0f, 255.0f)) : 0;
  });
  ColorImage picture(map.width(), map.height());
  cv::Mat colors, rgb = AsMat(picture);
  cv::applyColorMap(levels, colors, cv::COLORMAP_VIRIDIS);
  cv::cvtColor(colors, rgb, cv::COLOR_BGR2RGB);
  std::transform(map.begin(), map.end(), picture.begin(), picture.begin(), [](float value, const Rgb& color) {
    return std::isfinite(value) ? color : Rgb{0, 0, 0};
  });
  return picture;
}

ColorImage ColorizeBetweenQuantiles(const Image<float>& map) {
  std::vector<float> known;
  std::copy_if(map.begin(), map.end(), std::back_inserter(known), [](float v) { return std::isfinite(v); });
  if (known.empty()) return ColorImage(map.width(), map.height());
  const float low = Quantile(&known, kLowQuantile);
  return Colorize(map, low, Quantile(&known, kHighQuantile));
}

/// The positive values as `value_of` has them; NAN for the rest.
template <class ValueOf>
Image<float> KnownValues(const ImageView<const float>& map, const ValueOf& value_of) {
  Image<float> values = Clone(map);
  for (float& value : values) value = value > 0 ? value_of(value) : NAN;
  return values;
}

}  // namespace

ColorImage DepthPicture(const ImageView<const float>& depth) {
  return ColorizeBetweenQuantiles(KnownValues(depth, [](float z) { return 1.0f / z; }));
}

ColorImage NormalPicture(const ImageView<const Vec3f>& normal) {
  ColorImage picture(normal.width, normal.height);
  const auto to_byte = [](float v) { return static_cast<unsigned char>(std::lround(Clamp(127.5f * (v + 1), 0, 255))); };
  for (int row = 0; row < normal.height; ++row) {
    for (int col = 0; col < normal.width; ++col) {
      const Vec3f& n = normal(col, row);
      const bool known = n.x != 0 || n.y != 0 || n.z != 0;
      // y and z are turned round (up, towards the viewer), as normal maps are usually drawn.
      if (known) picture(col, row) = {to_byte(n.x), to_byte(-n.y), to_byte(-n.z)};
    }
  }
  return picture;
}

ColorImage CostPicture(const ImageView<const float>& cost) { return ColorizeBetweenQuantiles(Clone(cost)); }

ColorImage ConfidencePicture(const ImageView<const float>& confidence) {
  return Colorize(KnownValues(confidence, [](float c) { return c; }), 0.0f, 1.0f);
}

}  // namespace acmp
