#include "acmp_mapping/geometry/refined_camera.h"

#include <map>

#include "acmp_mapping/geometry/similarity.h"

namespace acmp {

std::vector<std::optional<PlacedCamera>> PlaceAlong(const std::vector<RefinedAndReceived>& keyframes) {
  std::map<uint64_t, std::vector<size_t>> of_world;
  for (size_t i = 0; i < keyframes.size(); ++i) of_world[keyframes[i].refined.world].push_back(i);
  std::vector<std::optional<PlacedCamera>> placed(keyframes.size());
  for (const auto& [world, members] : of_world) {
    if (members.size() < kMinForSimilarity) continue;
    std::vector<PosePair> poses;
    poses.reserve(members.size());
    for (const size_t i : members) poses.push_back({keyframes[i].refined.world_from_cam, keyframes[i].received});
    const std::vector<Similarity> aligned = AlignAlong(poses);
    for (size_t k = 0; k < members.size(); ++k) {
      const RefinedCamera& refined = keyframes[members[k]].refined;
      placed[members[k]] = {aligned[k].Moved(refined.world_from_cam), aligned[k].scale / refined.scale};
    }
  }
  return placed;
}

}  // namespace acmp
