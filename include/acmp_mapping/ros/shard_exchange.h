#pragma once

#include <functional>
#include <mutex>
#include <string>
#include <vector>

#include <acmp_mapping/KeyframeEstimate.h>
#include <acmp_mapping/KeyframePoints.h>
#include <ros/node_handle.h>

#include "acmp_mapping/mapping/dense_mapper.h"
#include "acmp_mapping/ros/drop.h"
#include "acmp_mapping/ros/keyframe_numbers.h"
#include "acmp_mapping/ros/mapper_worker.h"

namespace acmp {

/// What diagnostics tell about another shard.
struct PeerStatus {
  int index = 0;
  uint64_t received = 0;
  double last_received_s = 0;  ///< steady clock; of the start while nothing was received
};

/// Bytes in host order, which must be little-endian.
acmp_mapping::KeyframeEstimatePtr ToEstimateMessage(const ShardEstimate& estimate);
/// Throws InvalidInputError for sizes that do not fit each other.
ShardEstimate ToShardEstimate(const acmp_mapping::KeyframeEstimate& message);

/// The topics through which shards share their work: estimates among themselves, points for the node that merges the
/// maps. Publishing is thread-safe; handlers run in the node handle's callback queue.
class ShardExchange {
 public:
  struct Handlers {
    std::function<void(ShardEstimate)> on_estimate;  ///< of a keyframe that has the same number here
    std::function<void(int64_t)> on_flush;           ///< a peer was flushed after the keyframe of this number
    std::function<void()> on_period;                 ///< some times a second
    std::function<void(const Drop&)> on_drop;
  };

  /// @param numbers outlives this
  ShardExchange(ros::NodeHandle nh, const ShardOptions& shard, KeyframeNumbers* numbers, Handlers handlers);

  void PublishEstimate(const ShardEstimate& estimate, int64_t stamp_ns) const;
  void PublishFlush(int64_t number) const;
  void PublishPoints(const KeyframeOutput& output) const;
  void PublishDropped(int64_t number, int64_t stamp_ns, const std::string& reason) const;

  std::vector<PeerStatus> peers() const;

 private:
  acmp_mapping::KeyframeEstimatePtr Sign(acmp_mapping::KeyframeEstimatePtr message) const;
  void HandlePeriod();
  void Receive(const ros::MessageEvent<acmp_mapping::KeyframeEstimate const>& event);
  /// False when the message cannot be from a peer of this shard; says why.
  bool CheckSender(const acmp_mapping::KeyframeEstimate& message, const std::string& node);
  acmp_mapping::KeyframePointsPtr MakePointsMessage(int64_t number, int64_t stamp_ns) const;

  const ShardOptions shard_;
  const std::string node_name_;
  KeyframeNumbers* const numbers_;
  const Handlers handlers_;
  mutable std::mutex mutex_;  ///< guards peers_
  std::vector<PeerStatus> peers_;
  double next_alive_s_ = 0;
  ros::Publisher estimates_, points_;
  ros::WallTimer timer_;
  ros::Subscriber subscriber_;  // last: its callback uses what is above
};

}  // namespace acmp
