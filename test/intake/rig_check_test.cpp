#include "acmp_mapping/intake/rig_check.h"

#include <cmath>
#include <functional>

#include <Eigen/Geometry>

#include "acmp_mapping/synthetic/synthetic_scene.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "support/error_text.h"

namespace acmp {
namespace {

/// What is said of a pair that is declared as `change` makes it of the true transform from the left to the right
/// camera.
class RigCheckTest : public ::testing::Test {
 protected:
  static constexpr double kBaseline_m = 0.11;

  static std::vector<SyntheticView> Views(bool standing) {
    SyntheticSceneOptions options = {320, 240, 6};
    options.stereo_baseline_m = kBaseline_m;
    options.standing = standing;
    return MakeSyntheticScene(options);
  }

  using Change = std::function<RigidTransform(const RigidTransform&)>;

  static std::string Said(const std::vector<SyntheticView>& views, const Change& change, bool landmarks = true) {
    RigCheck check;
    return Judge(views, change, landmarks, &check);
  }
  static std::string Judge(const std::vector<SyntheticView>& views, const Change& change, bool landmarks,
                           RigCheck* check) {
    for (const SyntheticView& view : views) {
      Frame left, right;
      left.camera = view.frame.camera;
      left.gray = view.frame.gray.Clone();
      left.cam_from_world = view.frame.cam_from_world;
      if (landmarks) left.landmarks_in_world = view.frame.landmarks_in_world;
      right.camera = view.right->camera;
      right.gray = view.right->gray.Clone();
      right.cam_from_world = change(view.right->cam_from_world * left.cam_from_world.inverse()) * left.cam_from_world;
      check->Add(left, right);
    }
    return check->Judge(true);
  }

  static Change Scaled(double factor) {
    return [factor](RigidTransform truth) {
      truth.translation() *= factor;
      return truth;
    };
  }
  static Change Turned(double angle, const Eigen::Vector3d& axis) {
    return [=](const RigidTransform& truth) { return RigidTransform(Eigen::AngleAxisd(angle, axis)) * truth; };
  }
  /// The number that follows this in a text.
  static double NumberAfter(const std::string& words, const std::string& text) {
    const size_t at = text.find(words);
    return at == std::string::npos ? NAN : std::strtod(text.c_str() + at + words.size(), nullptr);
  }
  /// Rendered once.
  static const std::vector<SyntheticView>& ViewsOf(bool standing) {
    static const std::vector<SyntheticView> moving = Views(false), stands = Views(true);
    return standing ? stands : moving;
  }

  const std::vector<SyntheticView>&moving_ = ViewsOf(false), &standing_ = ViewsOf(true);
};

TEST_F(RigCheckTest, APairThatFitsIsNotToldOf) {
  for (const auto* views : {&moving_, &standing_}) {
    EXPECT_EQ(Said(*views, Scaled(1)), "");
    EXPECT_EQ(Said(*views, Scaled(1.08)), "") << "as calibrations are off";
  }
}

TEST_F(RigCheckTest, TheWrongSideIsNamed) {
  for (const auto* views : {&moving_, &standing_}) {
    EXPECT_THAT(Said(*views, Scaled(-1)), HasAll("(0.11, 0, 0) of the camera", "sign of P[3]", "T_cam_source"));
  }
}

TEST_F(RigCheckTest, ATurnIsToldAlsoThatOfImagesThatAreNotRectified) {
  const struct {
    double degrees;
    Eigen::Vector3d axis;
    double error;
  } turns[] = {{4, Eigen::Vector3d(1, 0.3, 0.5).normalized(), 0.7},
               {2, {0, 0, 1}, 0.3},
               {2, {0, 1, 0}, 0.3},
               {2, {0, -1, 0}, 0.3}};
  for (const auto* views : {&moving_, &standing_}) {
    for (const auto& [degrees, axis, error] : turns) {
      const std::string text = Said(*views, Turned(degrees * M_PI / 180, axis));
      EXPECT_THAT(text, HasSubstr("rectified"));
      EXPECT_NEAR(NumberAfter("turned by ", text), degrees, error) << axis << "\n" << text;
    }
  }
}

TEST_F(RigCheckTest, AnotherUnitIsNamedWithItsFactor) {
  for (const double factor : {0.3, 4.0, 100.0, 1000.0}) {
    const auto found = [&](const auto& views, bool landmarks) {
      return factor * NumberAfter("if it were ", Said(views, Scaled(factor), landmarks));
    };
    EXPECT_NEAR(found(moving_, true), 1, 0.15) << factor;
    EXPECT_NEAR(found(moving_, false), 1, 0.15) << factor << ", by its motion";
    EXPECT_NEAR(found(standing_, true), 1, 0.15) << factor << ", by landmarks";
    EXPECT_EQ(Said(standing_, Scaled(factor), false), "") << "nothing tells";
  }
  EXPECT_THAT(Said(moving_, Scaled(1000)), AllOf(HasSubstr("millimetres"), Not(HasSubstr("monocular"))));
}

/// A monocular frontend that begins anew has another scale.
TEST_F(RigCheckTest, AnotherWorldIsJudgedByItsOwnImages) {
  RigCheck check;
  EXPECT_NE(Judge(moving_, Scaled(4), true, &check), "");
  check.Clear();
  EXPECT_EQ(Judge(moving_, Scaled(1), true, &check), "");
}

TEST_F(RigCheckTest, ACameraOnAJointIsJudgedWhereItWas) {
  int call = 0;
  const auto turns = [&](const RigidTransform& truth) {  // its images stay as they are: later ones are wrong
    return ++call <= 3 ? truth : Turned(0.1 * call, Eigen::Vector3d::UnitY())(truth);
  };
  EXPECT_EQ(Said(moving_, turns), "");
}

TEST_F(RigCheckTest, ImagesOfAnotherTimeAreTold) {
  std::vector<SyntheticView> views = Views(false);
  // Each with the other camera's image of the far end of the path.
  for (size_t i = 0; i < views.size() / 2; ++i)
    std::swap(views[i].right->gray, views[views.size() - 1 - i].right->gray);
  EXPECT_THAT(Said(views, Scaled(1)), HasSubstr("instant"));
}

/// They lie on their lines, but nowhere near their depths.
TEST_F(RigCheckTest, ImagesThatAreLateAreTold) {
  std::vector<SyntheticView> views = Views(false);
  for (size_t i = views.size() - 1; i > 0; --i) views[i].right->gray = std::move(views[i - 1].right->gray);
  views.erase(views.begin());
  EXPECT_THAT(Said(views, Scaled(1)), HasSubstr("not of the same instant"));
}

TEST_F(RigCheckTest, ABaselineInAnotherDirectionIsNoTurn) {
  const auto swapped = [](const RigidTransform& truth) {  // P[7] in place of P[3]
    return RigidTransform(Eigen::Translation3d(0, truth.translation().x(), 0));
  };
  for (const auto* views : {&moving_, &standing_}) {
    EXPECT_THAT(Said(*views, swapped),
                AnyOf(HasSubstr("lay in direction (1, "), HasSubstr("lay in direction (0.99, ")));
  }
}

}  // namespace
}  // namespace acmp
