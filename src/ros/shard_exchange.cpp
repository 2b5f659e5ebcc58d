#include "acmp_mapping/ros/shard_exchange.h"

#include <cstring>
#include <utility>

#include <ros/this_node.h>
#include <boost/make_shared.hpp>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/ros/input_sources.h"
#include "acmp_mapping/ros/output_conversion.h"
#include "acmp_mapping/ros/topic_names.h"

namespace acmp {
namespace {

using acmp_mapping::KeyframeEstimate;
using acmp_mapping::KeyframePoints;

/// Messages. Shards are ahead of each other by some keyframes only, since each waits for the others' estimates.
constexpr uint32_t kQueue = 200;
constexpr double kPeriodS = 0.1;
constexpr double kAliveS = 1;

static_assert(sizeof(PlaneHypothesis) == 4 * sizeof(float), "as in KeyframeEstimate.msg");
static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "as in KeyframeEstimate.msg");

template <class T>
std::vector<uint8_t> ToBytes(const Image<T>& image) {
  std::vector<uint8_t> bytes(image.size() * sizeof(T));
  if (!bytes.empty()) std::memcpy(bytes.data(), image.data(), bytes.size());
  return bytes;
}

template <class T>
Image<T> FromBytes(const std::vector<uint8_t>& bytes, int width, int height) {
  Image<T> image(width, height);
  std::memcpy(static_cast<void*>(image.data()), bytes.data(), bytes.size());
  return image;
}

}  // namespace

acmp_mapping::KeyframeEstimatePtr ToEstimateMessage(const ShardEstimate& estimate) {
  auto message = boost::make_shared<KeyframeEstimate>();
  message->number = static_cast<uint64_t>(estimate.id);
  message->stage = estimate.stage == EstimateStage::kFast ? KeyframeEstimate::FAST : KeyframeEstimate::REFINED;
  message->width = static_cast<uint32_t>(estimate.state.planes.width());
  message->height = static_cast<uint32_t>(estimate.state.planes.height());
  message->planes = ToBytes(estimate.state.planes);
  message->cost = ToBytes(estimate.state.cost);
  return message;
}

ShardEstimate ToShardEstimate(const KeyframeEstimate& message) {
  CheckRange("stage", int{message.stage}, int{KeyframeEstimate::FAST}, int{KeyframeEstimate::REFINED});
  CheckRange("width", message.width, 0u, 65535u);
  CheckRange("height", message.height, 0u, 65535u);
  const size_t pixels = static_cast<size_t>(message.width) * message.height;
  if (message.planes.size() != pixels * sizeof(PlaneHypothesis) || message.cost.size() != pixels * sizeof(float)) {
    throw InvalidInputError(Concat("planes and cost have ", message.planes.size(), " and ", message.cost.size(),
                                   " bytes: must be 16 and 4 per pixel of ", message.width, " x ", message.height));
  }
  ShardEstimate estimate;
  estimate.id = static_cast<int64_t>(message.number);
  estimate.stage = message.stage == KeyframeEstimate::FAST ? EstimateStage::kFast : EstimateStage::kRefined;
  if (pixels == 0) return estimate;
  const int width = static_cast<int>(message.width), height = static_cast<int>(message.height);
  estimate.state = {FromBytes<PlaneHypothesis>(message.planes, width, height),
                    FromBytes<float>(message.cost, width, height)};
  return estimate;
}

ShardExchange::ShardExchange(ros::NodeHandle nh, const ShardOptions& shard, KeyframeNumbers* numbers, Handlers handlers)
    : shard_(shard), node_name_(ros::this_node::getName()), numbers_(numbers), handlers_(std::move(handlers)) {
  for (int index = 0; index < shard.count; ++index) {
    if (index != shard.index) peers_.push_back({index, 0, SteadySeconds()});
  }
  estimates_ = nh.advertise<KeyframeEstimate>(names::kKeyframeEstimates, kQueue);
  points_ = nh.advertise<KeyframePoints>(names::kKeyframePoints, kQueue);
  const boost::function<void(const ros::MessageEvent<KeyframeEstimate const>&)> receive =
      [this](const ros::MessageEvent<KeyframeEstimate const>& event) { Receive(event); };
  subscriber_ = nh.subscribe<KeyframeEstimate>(names::kKeyframeEstimates, kQueue, receive, ros::VoidConstPtr(),
                                               ros::TransportHints().tcpNoDelay());
  timer_ = nh.createWallTimer(ros::WallDuration(kPeriodS), [this](const ros::WallTimerEvent&) { HandlePeriod(); });
}

acmp_mapping::KeyframeEstimatePtr ShardExchange::Sign(acmp_mapping::KeyframeEstimatePtr message) const {
  message->shard_index = static_cast<uint16_t>(shard_.index);
  message->shard_count = static_cast<uint16_t>(shard_.count);
  return message;
}

void ShardExchange::PublishEstimate(const ShardEstimate& estimate, int64_t stamp_ns) const {
  const auto message = ToEstimateMessage(estimate);
  message->header.stamp.fromNSec(static_cast<uint64_t>(stamp_ns));
  estimates_.publish(Sign(message));
}

void ShardExchange::PublishFlush(int64_t number) const {
  const auto message = boost::make_shared<KeyframeEstimate>();
  message->number = static_cast<uint64_t>(number);
  message->stage = KeyframeEstimate::FLUSH;
  estimates_.publish(Sign(message));
}

void ShardExchange::HandlePeriod() {
  if (const double now_s = SteadySeconds(); now_s >= next_alive_s_) {
    next_alive_s_ = now_s + kAliveS;
    const auto message = boost::make_shared<KeyframeEstimate>();
    message->stage = KeyframeEstimate::ALIVE;
    estimates_.publish(Sign(message));
  }
  handlers_.on_period();
}

acmp_mapping::KeyframePointsPtr ShardExchange::MakePointsMessage(int64_t number, int64_t stamp_ns) const {
  auto message = boost::make_shared<KeyframePoints>();
  message->header.stamp.fromNSec(static_cast<uint64_t>(stamp_ns));
  message->number = static_cast<uint64_t>(number);
  message->shard_index = static_cast<uint16_t>(shard_.index);
  message->shard_count = static_cast<uint16_t>(shard_.count);
  return message;
}

void ShardExchange::PublishPoints(const KeyframeOutput& output) const {
  const auto message = MakePointsMessage(output.maps->frame->id, output.stamp_ns);
  message->header.frame_id = output.world_frame;
  Eigen::Map<Eigen::Matrix<double, 3, 4, Eigen::RowMajor>>(message->T_world_cam.data()) =
      output.world_from_cam.matrix().topRows<3>();
  std_msgs::Header camera = message->header;
  camera.frame_id = output.camera_frame;
  message->points = *ToCloudMessage(output.points_in_camera, camera);
  points_.publish(message);
}

void ShardExchange::PublishDropped(int64_t number, int64_t stamp_ns, const std::string& reason) const {
  const auto message = MakePointsMessage(number, stamp_ns);
  message->dropped = reason;
  points_.publish(message);
}

std::vector<PeerStatus> ShardExchange::peers() const {
  std::lock_guard<std::mutex> lock(mutex_);
  return peers_;
}

bool ShardExchange::CheckSender(const KeyframeEstimate& message, const std::string& node) {
  if (message.shard_count != shard_.count || message.shard_index >= message.shard_count) {
    handlers_.on_drop({"shard_count_mismatch",
                       Concat(node, " is shard ", message.shard_index, " of ", message.shard_count, ", this is ",
                              shard_.index, " of ", shard_.count, ": ~shard_count must be the same everywhere")});
    return false;
  }
  if (message.shard_index == shard_.index) {
    // A node hears its own messages, too.
    if (node != node_name_) {
      handlers_.on_drop({"shard_index_taken", Concat(node, " has ~shard_index = ", shard_.index, " as this node has")});
    }
    return false;
  }
  return true;
}

void ShardExchange::Receive(const ros::MessageEvent<KeyframeEstimate const>& event) {
  const KeyframeEstimate& message = *event.getConstMessage();
  if (!CheckSender(message, event.getPublisherName())) return;
  {
    std::lock_guard<std::mutex> lock(mutex_);
    PeerStatus& peer = peers_[message.shard_index - (message.shard_index > shard_.index ? 1u : 0u)];
    ++peer.received;
    peer.last_received_s = SteadySeconds();
  }
  if (message.stage == KeyframeEstimate::ALIVE) return;
  const auto number = static_cast<int64_t>(message.number);
  if (message.stage == KeyframeEstimate::FLUSH) return handlers_.on_flush(number);
  const std::string difference = numbers_->Compare(number, static_cast<int64_t>(message.header.stamp.toNSec()));
  if (!difference.empty()) {
    return handlers_.on_drop({"shard_numbering", Concat("shard ", message.shard_index, ": ", difference,
                                                        "; one of the two started later or missed a message")});
  }
  if (number % shard_.count != message.shard_index) {
    return handlers_.on_drop({"peer_estimate_refused", Concat("shard ", message.shard_index, " sent keyframe ", number,
                                                              ", which belongs to shard ", number % shard_.count)});
  }
  try {
    handlers_.on_estimate(ToShardEstimate(message));
  } catch (const InvalidInputError& error) {
    handlers_.on_drop(
        {"peer_estimate_refused", Concat("keyframe ", number, " of shard ", message.shard_index, ": ", error.what())});
  }
}

}  // namespace acmp
