// preset: auto changes the setting while images come. What it takes depends on the machine; that it says so, that the
// parameters follow and that no image is lost does not.

#include <dynamic_reconfigure/Reconfigure.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/ros/options.h"
#include "ros/mapper_control.h"

namespace acmp::test::auto_preset_rostest {

using ::testing::HasSubstr;

/// The mapper's parameters as they are: an empty request changes nothing.
DenseMapperConfig CurrentConfig() {
  dynamic_reconfigure::Reconfigure call;
  EXPECT_TRUE(CallService("/dense_mapper/set_parameters", &call));
  DenseMapperConfig config;
  config.__fromMessage__(call.response.config);
  return config;
}

TEST(AutoPreset, ChoosesWhileImagesComeAndLosesNone) {
  constexpr size_t kViews = 20;  // more than it takes to measure the first setting
  MapperControl mapper({{"preset", std::string("auto")}, {"max_source_views", 4}});
  ASSERT_TRUE(mapper.WaitUntilReady());
  const std::vector<ViewMessages> scene = MakeSmallScene(kViews);
  EXPECT_EQ(mapper.Map(scene), kViews);

  EXPECT_TRUE(mapper.WaitForLog({"preset auto: ", " % of max_image_size"}));
  const std::string said = mapper.DiagnosticValue("dense_mapper: mapping", "preset auto");  // the last word
  EXPECT_THAT(said, HasSubstr("keyframes come every 0.1 s"));

  const AutoPreset::Setting* chosen = nullptr;
  for (const AutoPreset::Setting& setting : AutoPreset::Settings()) {
    if (said.rfind(Concat(setting.preset, ", ", 100 * setting.size, " % "), 0) == 0) chosen = &setting;
  }
  ASSERT_NE(chosen, nullptr) << said;
  const DenseMapperConfig config = CurrentConfig();
  EXPECT_EQ(config.max_source_views, 4) << "the given limit";
  EXPECT_EQ(config.geometric_passes, MakePreset(chosen->preset).geometric_passes) << said;
}

}  // namespace acmp::test::auto_preset_rostest
