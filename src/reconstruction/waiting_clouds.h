#pragma once

#include <map>
#include <mutex>

#include "acmp_mapping/fusion/point_cloud.h"
#include "output_folder.h"

namespace acmp {

/// Points of views that are fused and wait for their place in the cloud, which is known when all earlier views are
/// fused. In memory up to a number of bytes, beyond in files of the work folder, so that a scene of any size can be
/// fused (but COLMAP's model keeps all points). For any number of threads.
class WaitingClouds {
 public:
  /// @param folder outlives this
  WaitingClouds(const OutputFolder* folder, size_t max_bytes) : folder_(*folder), max_bytes_(max_bytes) {}

  /// Keeps a view's points; once per view. Throws ProcessingError when their file cannot be written.
  void Put(int index, PointCloud cloud);
  /// How many they are, until they are handed out.
  size_t NumPoints(int index) const;
  /// Hands them out, once. Throws ProcessingError when their file cannot be read.
  PointCloud Take(int index);

  static constexpr const char* kKind = "clouds";

 private:
  bool KeepInMemory(int index, PointCloud* cloud);

  const OutputFolder& folder_;
  const size_t max_bytes_;

  mutable std::mutex mutex_;  ///< of what follows
  std::map<int, PointCloud> in_memory_;
  std::map<int, size_t> points_in_file_;
  size_t bytes_ = 0;  ///< in memory
};

}  // namespace acmp
