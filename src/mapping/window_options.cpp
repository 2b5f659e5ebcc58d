#include "acmp_mapping/mapping/window_options.h"

namespace acmp {
namespace {

OptionTable<DenseMapperOptions> MakeWindowOptionTable() {
  OptionTable<DenseMapperOptions> table;
  table.Group("window of keyframes");
  table.Add(
      Number("window_size", 2, kMaxWindowSize, "",
             "Keyframes kept to match against; each takes 55 bytes of GPU memory per pixel"),
      [](auto& o) -> auto& { return o.window_size; });
  table.Add(
      Number("lookahead", 0, kMaxWindowSize - 1, "",
             "Later keyframes that a refined map waits for, below window_size; 0: lowest latency")
          .WhileRunning(),
      [](auto& o) -> auto& { return o.lookahead; });
  table.Add(
      Number("max_source_views", 1, kMaxSourceViews, "",
             "Keyframes that each keyframe is matched against; time grows with it")
          .WhileRunning(),
      [](auto& o) -> auto& { return o.source_views.max_source_views; });
  table.Add(
      Flag(
          "refine_again",
          "Refine a keyframe once more halfway through the window, and at a flush, where its views have become better"),
      [](auto& o) -> auto& { return o.refine_again; });
  table.Add(
      PoseRefinementOptionTable().Find("refine_poses").description, [](auto& o) -> auto& { return o.poses.refine; });
  table.Add(
      Number("depth_min", 0, 1e9, "(unit of the poses)",
             "Nearest depth to search where no sparse points tell, with depth_max; 0: none")
          .WhileRunning(),
      [](auto& o) -> auto& { return o.fallback_depth_range.min; });
  table.Add(
      Number("depth_max", 0, 1e9, "(unit of the poses)", "Farthest depth to search there").WhileRunning(),
      [](auto& o) -> auto& { return o.fallback_depth_range.max; });
  return table;
}

}  // namespace

const OptionTable<DenseMapperOptions>& WindowOptionTable() {
  static const OptionTable<DenseMapperOptions> table = MakeWindowOptionTable();
  return table;
}

}  // namespace acmp
