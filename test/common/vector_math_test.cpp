#include "acmp_mapping/common/vector_math.h"

#include <Eigen/Geometry>
#include <limits>

#include "gtest/gtest.h"

#include "acmp_mapping/common/random.h"

namespace acmp {
namespace {

Vec3f RandomVector(RandomStream* random) {
  const float x = random->NextUniform(-9, 9), y = random->NextUniform(-9, 9), z = random->NextUniform(-9, 9);
  return {x, y, z};
}

Eigen::Vector3d ToDouble(const Vec3f& v) { return {v.x, v.y, v.z}; }

void ExpectNear(const Vec3f& value, const Eigen::Vector3d& expected) {
  // Sums of three products below 100: a few roundings of 2^-24 relative to 300.
  constexpr double kTolerance = 1e-4;
  EXPECT_NEAR(value.x, expected.x(), kTolerance);
  EXPECT_NEAR(value.y, expected.y(), kTolerance);
  EXPECT_NEAR(value.z, expected.z(), kTolerance);
}

TEST(VectorMathTest, AgreesWithEigen) {
  RandomStream random(1, 0, 0);
  for (int i = 0; i < 200; ++i) {
    const Vec3f a = RandomVector(&random), b = RandomVector(&random);
    const float s = random.NextUniform(-3, 3);
    Mat3f matrix;
    Eigen::Matrix3d expected;
    for (int k = 0; k < 9; ++k) expected(k / 3, k % 3) = matrix.m[k] = random.NextUniform(-9, 9);

    ExpectNear(a + b, ToDouble(a) + ToDouble(b));
    ExpectNear(a - b, ToDouble(a) - ToDouble(b));
    ExpectNear(s * a, s * ToDouble(a));
    ExpectNear(Cross(a, b), ToDouble(a).cross(ToDouble(b)));
    ExpectNear(matrix * a, expected * ToDouble(a));
    EXPECT_NEAR(Dot(a, b), ToDouble(a).dot(ToDouble(b)), 1e-4);
    EXPECT_NEAR(Norm(a), ToDouble(a).norm(), 1e-5);
    ExpectNear(Normalized(a), ToDouble(a).normalized());
  }
}

TEST(VectorMathTest, ClampKeepsLimitsAndMapsNanToTheLowOne) {
  EXPECT_EQ(Clamp(0.5f, 0.0f, 1.0f), 0.5f);
  EXPECT_EQ(Clamp(-0.5f, 0.0f, 1.0f), 0.0f);
  EXPECT_EQ(Clamp(1.5f, 0.0f, 1.0f), 1.0f);
  constexpr float kInf = std::numeric_limits<float>::infinity();
  EXPECT_EQ(Clamp(kInf, 0.0f, 1.0f), 1.0f);
  EXPECT_EQ(Clamp(-kInf, 0.0f, 1.0f), 0.0f);
  EXPECT_EQ(Clamp(std::numeric_limits<float>::quiet_NaN(), -3.0f, 1.0f), -3.0f);
}

}  // namespace
}  // namespace acmp
