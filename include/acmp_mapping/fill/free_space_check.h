#pragma once

#include "acmp_mapping/fill/kernel/free_space.h"
#include "acmp_mapping/geometry/pinhole_camera.h"

namespace acmp {

/// Gives kUnsupportedCost to pixels that no texture speaks for and whose surface would hide something that is evidently
/// farther away (RemoveUnsupportedPixel): walls drawn into a sky, above all.
/// @param evidence of cells of EvidenceCellSize (MeasureEvidence)
/// @param planes,cost of the camera's size; the costs change
void RemoveUnsupported(const PinholeCamera& camera, const ImageView<const float>& evidence,
                       const ImageView<PlaneHypothesis>& planes, const ImageView<float>& cost);

/// A context to find textured pixels, without seeds (`fitted`, `nearest`), which depend on the device. The nearest are
/// taken, as none is surer than another.
FillContext MakeTexturedContext(const PinholeCamera& camera, const ImageView<PlaneHypothesis>& planes,
                                const ImageView<float>& cost);

}  // namespace acmp
