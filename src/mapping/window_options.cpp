#include "acmp_mapping/mapping/window_options.h"

namespace acmp {

OptionList OptionsOf(DenseMapperOptions* o) {
  OptionList list;
  list.Group("window of keyframes");
  list.Number("window_size", &o->window_size, 2, kMaxWindowSize, "",
              "Keyframes kept to match against; each takes 55 bytes of GPU memory per pixel");
  list.Number("lookahead", &o->lookahead, 0, kMaxWindowSize - 1, "",
              "Later keyframes that a refined map waits for, below window_size; 0: lowest latency")
      .WhileRunning();
  list.Number("max_source_views", &o->source_views.max_source_views, 1, kMaxSourceViews, "",
              "Keyframes that each keyframe is matched against; time grows with it")
      .WhileRunning();
  list.Flag("refine_again", &o->refine_again,
            "Refine a keyframe once more halfway through the window, and at a flush, where its views have become "
            "better");
  const Option refine_poses = OptionsOf(&o->poses).Find("refine_poses");
  list.Add(refine_poses.name, refine_poses.sentence, refine_poses.get, refine_poses.set).choices = refine_poses.choices;
  list.Number(
          "depth_min", &o->fallback_depth_range.min, 0, 1e9, "(unit of the poses)",
          "Nearest depth to search where no sparse points tell, with depth_max; 0: found by matches between keyframes")
      .WhileRunning();
  list.Number("depth_max", &o->fallback_depth_range.max, 0, 1e9, "(unit of the poses)",
              "Farthest depth to search there")
      .WhileRunning();
  return list;
}

}  // namespace acmp
