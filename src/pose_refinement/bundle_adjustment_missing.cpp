// In place of bundle_adjustment.cpp where there is no Ceres.

#include "acmp_mapping/common/error.h"
#include "bundle_adjustment.h"

namespace acmp {

bool AdjustBundle(const BundleWeights&, int, size_t, Bundle*, CameraErrors*) {
  throw InvalidInputError("poses cannot be refined: this build has no Ceres");
}

}  // namespace acmp
