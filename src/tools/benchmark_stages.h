#pragma once

#include <string>
#include <utility>
#include <vector>

#include "acmp_mapping/dataset/image_codec.h"
#include "acmp_mapping/mapping/dense_mapper.h"

namespace acmp {

/// Milliseconds per image.
struct StageMs {
  // Device time where the engine measures it, wall time elsewhere.
  double photometric = 0, planar_prior = 0, geometric = 0;
  // Wall time.
  double load = 0;           ///< one image to the device
  double triangulation = 0;  ///< support points and Delaunay
  double consistency = 0;    ///< filter with confidence and points
  double download = 0;       ///< depth, normals, cost
  double fast = 0;           ///< image in to fast maps in host memory
  double whole = 0;          ///< image in to refined maps and points in host memory
};

struct StageFigures {
  ImageSize size;
  int source_views = 0;
  StageMs median;           ///< of the runs
  size_t device_bytes = 0;  ///< of images, estimates and scratch
};

/// Runs the stages on a textured wall seen by `source_views` + 1 cameras.
StageFigures MeasureStages(DepthEngine* engine, const PipelineOptions& options, ImageSize size, int source_views,
                           int repetitions);

/// A stream of keyframes through the online mapper.
struct StreamFigures {
  ImageSize size;
  int source_views = 0;
  int keyframes = 0;
  double fast_median = 0, fast_99 = 0;        ///< ms from the colour image to on_fast
  double refined_median = 0, refined_99 = 0;  ///< ms from the colour image to on_refined of another keyframe
  double device_median = 0;                   ///< ms of device time per keyframe until its refined maps are out
  double keyframes_per_s = 0;
  // After a tenth of the stream, and at its end.
  size_t device_bytes_begin = 0, device_bytes_end = 0, host_bytes_begin = 0, host_bytes_end = 0;
};

/// Feeds a camera that moves along a textured wall to a mapper with these options.
StreamFigures MeasureStream(DepthEngine* engine, const DenseMapperOptions& options, ImageSize size, int keyframes);

/// What a preset keeps up with.
struct ExpectedRates {
  std::string preset;
  StreamFigures measured;                                    ///< at a small size
  std::vector<std::pair<ImageSize, double>> computed_rates;  ///< keyframes per second: the time grows with the pixels
};

/// Measures a short stream for each preset that the online mapper takes. @param options all but the pipeline's
std::vector<ExpectedRates> MeasureExpectedRates(DepthEngine* engine, const DenseMapperOptions& options, ImageSize size,
                                                int keyframes);

/// What `preset: auto` chooses for keyframes that come every `interval_s` seconds: what it says each time it changes,
/// and where it stays. @param options all but the pipeline's. @param size the largest allowed
std::vector<std::string> MeasureAutoPreset(DepthEngine* engine, const DenseMapperOptions& options, ImageSize size,
                                           double interval_s);

}  // namespace acmp
