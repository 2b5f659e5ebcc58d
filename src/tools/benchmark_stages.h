#pragma once

#include <string>
#include <utility>
#include <vector>

#include "acmp_mapping/dataset/image_codec.h"
#include "acmp_mapping/mapping/dense_mapper.h"

namespace acmp {

/// What was measured: title of the column, value.
using Figures = std::vector<std::pair<std::string, double>>;

/// Runs the stages on a textured wall seen by `source_views` + 1 cameras. Returns medians of the runs: ms per image, of
/// the passes the device's time where the engine measures it, and bytes on the device per pixel.
Figures MeasureStages(DepthEngine* engine, const PipelineOptions& options, ImageSize size, int source_views,
                      int repetitions);

/// Feeds a camera that moves along a textured wall to a mapper with these options. Returns keyframes per second; ms
/// from the colour image to on_fast, and to on_refined of another keyframe; ms of device time per keyframe until its
/// refined maps are out; memory after a tenth of the stream and at its end.
Figures MeasureStream(DepthEngine* engine, const DenseMapperOptions& options, ImageSize size, int keyframes);

/// Keyframes per second that a preset keeps up with.
struct ExpectedRates {
  std::string preset;
  double measured = 0;                                 ///< at a small size
  std::vector<std::pair<ImageSize, double>> computed;  ///< the time grows with the pixels
};

/// Measures a short stream for each preset that the online mapper takes. @param options all but the pipeline's
std::vector<ExpectedRates> MeasureExpectedRates(DepthEngine* engine, const DenseMapperOptions& options, ImageSize size,
                                                int keyframes);

/// What `preset: auto` chooses for keyframes that come every `interval_s` seconds: what it says each time it changes,
/// and where it stays. @param options all but the pipeline's. @param size the largest allowed
std::vector<std::string> MeasureAutoPreset(DepthEngine* engine, const DenseMapperOptions& options, ImageSize size,
                                           double interval_s);

}  // namespace acmp
