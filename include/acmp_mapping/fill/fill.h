#pragma once

#include "acmp_mapping/fill/fill_options.h"
#include "acmp_mapping/fill/kernel/fill_grid.h"
#include "acmp_mapping/fill/kernel/free_space.h"
#include "acmp_mapping/fusion/depth_fusion.h"
#include "acmp_mapping/keyframe/depth_range.h"

namespace acmp {

/// When a source view confirms a pixel: forward-backward error below 2 px, depths within 0.3 %. The two limits that
/// CountSupportingViews reads, and no others.
FusionLimits ConsistencyLimits();

/// Source views that must confirm a pixel which is extended, of `num_sources` that have a map: four, or half of all.
int SeedViews(int num_sources);

/// Source views that must confirm a pixel which stays as it is: two, or one of fewer than seven, but no more than a
/// seed needs. Of ten views one often agrees by chance: of pixels that one confirmed within 2 % 24 % were within 2 cm,
/// of those with two to four 42 %. Before passes they must confirm it closely.
int MinConsistentViews(int num_sources);

/// Source views that must confirm a seed closely to make it a closely confirmed one: one more than a seed needs,
/// half of all suffice.
int StrongViews(int num_sources);

/// A context without its maps and seeds, which depend on the device. Throws InvalidInputError for a range that is none.
FillContext MakeFillContext(const PinholeCamera& camera, const DepthRange& range, const FillOptions& options,
                            int num_sources);

/// Gives pixels that hardly any source view confirms (MinConsistentViews) the plane of their surroundings: robust
/// planes are fitted to the confirmed pixels around, a square of 19 % of the image's longer side, and each pixel takes
/// the weighted median of the nearest ones in 16 directions. Before passes it takes another one of the 16: the plane
/// on which most seeds lie, where seeds that more views confirm closely go before nearer seeds. Filled pixels that no
/// view had confirmed get kWorstCost, the others kUnverifiedCost. Then, if it is asked for, a weighted median
/// (WeightedMedianPixel) where surfaces meet: a window beside something nearer takes its depth, all views do so alike,
/// and surfaces in the free space of sources count less.
/// @param setup with ConsistencyLimits, of maps in host memory as they were before; without sources nothing changes
/// @param planes,cost of the reference; changed
void FillUnverified(const FusionSetup& setup, const DepthRange& range, const FillOptions& options,
                    const ImageView<PlaneHypothesis>& planes, const ImageView<float>& cost);

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
