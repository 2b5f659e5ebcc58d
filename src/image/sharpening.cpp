#include "acmp_mapping/image/sharpening.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <optional>
#include <vector>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/image/image_processing.h"

namespace acmp {
namespace {

constexpr double kBlur_px = 0.7;
constexpr int kBlurSize = 5;  // 3.6 standard deviations to each side
constexpr int kNoiseBlock = 8;
constexpr int kNeighbourhood = 5;   // over which detail is compared with noise
constexpr float kStrongDetail = 4;  // grey levels
constexpr float kNoiseMargin = 2;   // times the noise's variance: its mean over 25 px varies by a quarter

/// Variance of white noise of variance 1 in what the blur takes away.
double DetailOfWhiteNoise() {
  const cv::Mat kernel = cv::getGaussianKernel(kBlurSize, kBlur_px, CV_64F);
  const double center = kernel.at<double>(kBlurSize / 2), squares = kernel.dot(kernel);
  return 1 - 2 * center * center + squares * squares;
}

/// Mean absolute difference of second differences over a block of pixels; none where it touches black or white.
std::optional<double> MeanDifference(const GrayImage& gray, int first_col, int first_row) {
  constexpr float kBlack = 1, kWhite = 254;
  float least = kWhite, most = kBlack, sum = 0;
  for (int row = first_row; row < first_row + kNoiseBlock; ++row) {
    const float *above = &gray(first_col - 1, row - 1), *middle = &gray(first_col - 1, row),
                *below = &gray(first_col - 1, row + 1);
    float second[kNoiseBlock + 2];
    for (int i = 0; i < kNoiseBlock + 2; ++i) second[i] = above[i] - 2 * middle[i] + below[i];
    for (int i = 1; i <= kNoiseBlock; ++i) {
      sum += std::abs(second[i - 1] - 2 * second[i] + second[i + 1]);
      least = std::min(least, middle[i]);
      most = std::max(most, middle[i]);
    }
  }
  if (least <= kBlack || most >= kWhite) return std::nullopt;
  return sum / (kNoiseBlock * kNoiseBlock);
}

/// The sharpened strip of Sharpen, from b, gray - b and v.
void Combine(const cv::Mat& blurred, const cv::Mat& detail, const cv::Mat& power, float gain, float noise_power,
             cv::Mat* sharp) {
  constexpr float kStrongPower = kStrongDetail * kStrongDetail;
  const float extra = (gain - 1) * kStrongPower;
  for (int row = 0; row < sharp->rows; ++row) {
    const auto *b = blurred.ptr<float>(row), *d = detail.ptr<float>(row), *v = power.ptr<float>(row);
    auto* to = sharp->ptr<float>(row);
    for (int col = 0; col < sharp->cols; ++col) {
      // max(0, 1 - noise_power / v) times 1 + (gain - 1) kStrongPower / (kStrongPower + v), with one division.
      const float above = std::max(v[col] - noise_power, 0.0f);
      const float strong = kStrongPower + v[col];
      const float factor = above * (strong + extra) / (std::max(v[col], noise_power) * strong);
      to[col] = std::min(std::max(b[col] + factor * d[col], 0.0f), 255.0f);
    }
  }
}

}  // namespace

double EstimateNoise(const GrayImage& gray) {
  constexpr double kRounding = 0.193;  // sqrt(0.299^2 + 0.587^2 + 0.114^2) / sqrt(12)
  constexpr int kMaxBlocks = 1 << 10;  // to four times as many; more change the quartile by less than 1 %
  const int block_rows = (gray.height() - 2) / kNoiseBlock, block_cols = (gray.width() - 2) / kNoiseBlock;
  const int step = std::max(1, static_cast<int>(std::sqrt(block_rows * block_cols / kMaxBlocks)));
  std::vector<double> deviations;
  for (int row = 0; row < block_rows; row += step) {
    for (int col = 0; col < block_cols; col += step) {
      const std::optional<double> mean = MeanDifference(gray, 1 + kNoiseBlock * col, 1 + kNoiseBlock * row);
      if (mean) deviations.push_back(*mean);
    }
  }
  if (deviations.empty()) return kRounding;
  const auto quartile = deviations.begin() + static_cast<long>(deviations.size() / 4);
  std::nth_element(deviations.begin(), quartile, deviations.end());
  constexpr double kWeights = 6;             // root of the sum of the squares of a difference's weights
  constexpr double kMeanOfNormal = 0.79788;  // of the absolute values of a standard normal variable
  return std::max(kRounding, *quartile / (kWeights * kMeanOfNormal));
}

void Sharpen(double gain, GrayImage* gray) {
  CheckRange("sharpening", gain, 0.0, kMaxSharpening);
  if (gain == 0 || gray->size() == 0) return;
  const double noise = EstimateNoise(*gray);
  const auto noise_power = static_cast<float>(kNoiseMargin * noise * noise * DetailOfWhiteNoise());
  // In strips that stay in the cache. OpenCV reads what lies around a part of an image where the filters reach there.
  constexpr int kStripRows = 32;
  constexpr int kReach = kNeighbourhood / 2;
  GrayImage result(gray->width(), gray->height());
  const cv::Mat source = AsMat(*gray);
  const cv::Mat target = AsMat(result);
  const cv::Mat mean(1, kNeighbourhood, CV_32F, cv::Scalar(1.0 / kNeighbourhood));
  const int strips = (source.rows + kStripRows - 1) / kStripRows;
  tbb::parallel_for(tbb::blocked_range<int>(0, strips), [&](const tbb::blocked_range<int>& range) {
    cv::Mat blurred, detail, squares, power;
    for (int i = range.begin(); i < range.end(); ++i) {
      const cv::Range rows(i * kStripRows, std::min((i + 1) * kStripRows, source.rows));
      const cv::Range around(std::max(rows.start - kReach, 0), std::min(rows.end + kReach, source.rows));
      const cv::Range inner = rows - around.start;
      const cv::Mat strip = source.rowRange(around);
      cv::GaussianBlur(strip, blurred, cv::Size(kBlurSize, kBlurSize), kBlur_px);
      cv::subtract(strip, blurred, detail);
      cv::multiply(detail, detail, squares);
      cv::sepFilter2D(squares.rowRange(inner), power, CV_32F, mean, mean);  // blur() would sum in double
      cv::Mat sharp = target.rowRange(rows);
      Combine(blurred.rowRange(inner), detail.rowRange(inner), power, static_cast<float>(gain), noise_power, &sharp);
    }
  });
  *gray = std::move(result);
}

}  // namespace acmp
