#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <utility>
#include <vector>

#include <acmp_mapping/KeyframePoints.h>
#include <image_transport/image_transport.h>
#include <ros/node_handle.h>
#include <tf2_ros/static_transform_broadcaster.h>

#include "acmp_mapping/intake/reading_check.h"
#include "acmp_mapping/ros/incident_log.h"
#include "acmp_mapping/ros/keyframe_outputs.h"

namespace acmp {

/// Publishes what a DenseMapper's callbacks bring, and counts it. A message is only made when somebody listens: images
/// of the newest refined keyframe also for who comes later. (These topics are latched, too, but a latch has what was
/// last sent to anybody, and comes before it.) Callbacks come one at a time, beside the mapper's thread; all else but
/// ForgetNewest may be called by any thread.
class OutputPublisher {
 public:
  /// @param mapper name of the mapper's node, for the map
  /// @param incidents where `report` counts; outlives this
  /// @param report of any thread: tells of what is not published or not used
  OutputPublisher(ros::NodeHandle nh, std::string mapper, const IncidentLog* incidents,
                  std::function<void(const RejectedInput&)> report);

  /// For a mapper of ReceivedFrame's, which this must outlive.
  DenseMapper::Callbacks MakeCallbacks();

  /// Depth below is left out, 0..1.
  void set_min_depth_confidence(double confidence) { min_depth_confidence_ = confidence; }
  /// Images that have come with their poses so far. With each message goes how many of them had no end yet. One that
  /// waits for its pose may never get it, and no flush finishes it.
  void set_images(uint64_t images) { images_ = images; }
  /// The gate has passed over a posed image: that is its end.
  void PassOver() { ++passed_over_; }
  uint64_t passed_over() const { return passed_over_; }

  /// Tells of it, unless stopped.
  void Report(const RejectedInput& rejected) const;
  /// What comes is of another run: who comes later gets nothing of the one before. Not beside a callback. Listeners of
  /// topics that have been published on are connected anew, which is waited for, but for a second at most.
  void ForgetNewest();
  /// From now on nothing is published or told, but for what is under way.
  void Stop() { stopping_ = true; }
  bool is_stopping() const { return stopping_; }

  OutputStatus status() const;
  /// Of the keyframes that have had their first map, or got none. To be cleared when what comes is of another world.
  ReadingCheck& readings() { return reading_check_; }
  /// Nodes that listen to keyframe_points.
  uint32_t maps() const { return keyframe_points_.getNumSubscribers(); }
  /// Messages sent on keyframe_points.
  uint64_t points_sent() const { return points_sent_; }

 private:
  void HandleFast(const KeyframeDepthPtr& maps);
  void HandleRefined(const KeyframeDepthPtr& maps);
  void HandleDrop(const KeyframeDrop& drop);
  /// Runs `publish` with what is ready to be published; what it throws is told, since callbacks must not throw.
  template <class PublishOutput>
  void Publish(const KeyframeDepthPtr& maps, const PublishOutput& publish);
  template <class Change>
  void UpdateStatus(const Change& change) {
    const std::lock_guard<std::mutex> lock(status_mutex_);
    change(&status_);
  }

  void PublishRefined(const KeyframeOutput& output);
  /// @param replaces points that were sent before
  void PublishKeyframePoints(const KeyframeOutput& output, bool replaces);
  void PublishPose(const CaptureOrigin& origin);
  void PublishKeyframeDepth(const KeyframeOutput& output);

  using MakeImage = std::function<sensor_msgs::ImagePtr(const KeyframeOutput&)>;
  struct ImagePublisher {
    std::function<uint32_t()> listeners;
    std::function<void(const KeyframeOutput&)> publish;
  };
  /// A latched image topic.
  struct RefinedTopic {
    std::function<ImagePublisher()> advertise;
    ImagePublisher publisher = advertise();
    bool has_published = false;  ///< so that roscpp holds a message
  };
  /// The image topics of a face; those of the one that looks ahead have no prefix.
  struct ImageTopics {
    image_transport::CameraPublisher depth_fast;
    std::vector<RefinedTopic> refined;
  };
  /// Advertises them when a face is first seen, and says in tf where it looks.
  ImageTopics& TopicsOf(const ReceivedFrame& frame);
  void Advertise(const std::string& face, ImageTopics* topics);
  /// What is called with a new subscriber: sends it the newest refined message of the face.
  template <class Make>
  auto ForNewcomers(const std::string& face, Make make) {
    return [this, face, make](const auto& newcomer) {
      KeyframeDepthPtr newest;
      UpdateStatus([&](OutputStatus* /*status*/) {
        const auto found = newest_.find(face);
        if (found != newest_.end()) newest = found->second;
      });
      if (newest) Publish(newest, [&](const KeyframeOutput& output) { newcomer.publish(make(output)); });
    };
  }

  const std::string mapper_;
  const IncidentLog* const incidents_;
  const std::function<void(const RejectedInput&)> report_;
  std::atomic<bool> stopping_{false};
  std::atomic<double> min_depth_confidence_{0};
  std::atomic<uint64_t> images_{0}, passed_over_{0};
  ReadingCheck reading_check_;
  mutable std::mutex status_mutex_;  ///< held for a moment only
  OutputStatus status_;
  std::map<std::string, KeyframeDepthPtr> newest_;        ///< refined, of each face
  std::vector<acmp_mapping::KeyframePointsPtr> waiting_;  ///< for the first map that listens
  std::atomic<uint64_t> points_sent_{0};
  image_transport::ImageTransport transport_;
  ros::NodeHandle nh_;
  std::map<std::string, ImageTopics> image_topics_;                   ///< of each face
  std::unique_ptr<tf2_ros::StaticTransformBroadcaster> face_frames_;  ///< none before there is a face that looks aside
  ros::Publisher points_;
  ros::Publisher pose_;
  ros::Publisher keyframe_points_;
  ros::Publisher keyframe_depth_;
};

}  // namespace acmp
