#pragma once

namespace acmp {

constexpr double kRad = 3.14159265358979323846 / 180;  ///< radians of a degree

}  // namespace acmp
