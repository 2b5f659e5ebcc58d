#pragma once

#include <atomic>
#include <condition_variable>
#include <functional>
#include <memory>
#include <mutex>
#include <string>

#include <acmp_mapping/GetDistances.h>
#include <ros/node_handle.h>
#include <std_msgs/Header.h>

#include "acmp_mapping/map/distance_field.h"
#include "acmp_mapping/ros/map_output.h"
#include "acmp_mapping/ros/options.h"

namespace acmp {

/// The topics occupancy (latched), distance_slice (latched: distances of the plane through the newest camera that is
/// most level in its image; of the first mapper) and distance_change, and the service get_distances: all of one
/// occupancy map, which follows the map. Nothing is computed, nor held in memory, while nobody listens or has asked for
/// kAskedForS.
class OccupancyOutput {
 public:
  static constexpr double kAskedForS = 10;
  static constexpr size_t kMaxPoints = 100000;  ///< of a call

  /// @param map and map_output outlive this
  /// @param report told why a topic is not published, and what is less than it should be; in the thread of
  /// PublishIfDue
  OccupancyOutput(ros::NodeHandle nh, const MapStore* map, const MapServerOptions& options, MapOutput* map_output,
                  std::function<void(const RejectedInput&)> report);

  /// Publishes what is due. May take minutes for a map that is there already: in a thread of its own, often.
  void PublishIfDue();

  /// Has the topic occupancy published, whatever map_publish_rate says. In any thread.
  void Request() { is_requested_ = true; }

  /// Waits for the first distances; ends with MapOutput::Stop. Throws InvalidInputError for too many or infinite points
  /// and an empty map, ProcessingError where distances cannot be computed. In another thread.
  acmp_mapping::GetDistances::Response Answer(const acmp_mapping::GetDistances::Request& request);

 private:
  /// Distances and what they are of.
  struct Distances {
    std::shared_ptr<const DistanceGrid> grid;
    std_msgs::Header header;
    std::string failure;  ///< why there are none; empty: they have not been asked for
  };
  bool IsAskedFor() const { return SteadySeconds() < asked_until_s_; }
  uint32_t DistanceListeners() const { return slice_.getNumSubscribers() + change_.getNumSubscribers(); }
  void Update(bool publish_grid, bool publish_distances);
  void PublishGrid(const PlacedKeyframes& map, const std_msgs::Header& header);
  void PublishDistances(const PlacedKeyframes& map, const LiveOccupancy::Change& change, uint64_t version,
                        const std_msgs::Header& header);
  /// Takes back what was published. @param failure the answer to whoever asks for distances
  void PublishEmpty(const std::string& failure);
  void PublishNoDistances(const std::string& failure);
  void Set(Distances distances);

  const MapStore* const map_;
  const MapServerOptions options_;
  MapOutput* const map_output_;
  const std::function<void(const RejectedInput&)> report_;
  PublishPace grid_pace_, distance_pace_;
  std::atomic<double> asked_until_s_{0};  ///< steady clock
  std::atomic<bool> is_requested_{false};

  // Of the thread of PublishIfDue.
  LiveOccupancy occupancy_;
  DistanceField field_;
  LiveOccupancy::Change missed_;                    ///< by the field, since its last update
  std_msgs::Header grid_header_, distance_header_;  ///< of what was published last; no frame: nothing
  std::string
      mapper_;  ///< whose newest camera the slice, and a part of a map, lie at: the first one's, while it is there

  std::mutex mutex_;  ///< guards what follows
  std::condition_variable made_;
  Distances distances_;

  ros::Publisher grid_, slice_, change_;  ///< last: their callbacks use what is above
};

}  // namespace acmp
