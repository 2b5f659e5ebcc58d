#pragma once

#include <atomic>
#include <thread>
#include <vector>

#include "ros/mapper_control.h"

namespace acmp::test {

/// Publishes the scene over and over, as a looping bag does, until destroyed.
class EndlessPlayer {
 public:
  explicit EndlessPlayer(const ScenePlayer& player)
      : thread_([this, &player] {
          const std::vector<ViewMessages> scene = MakeSmallScene(12);
          for (size_t i = 0; !stop_; ++i) {
            player.Publish(scene[i % scene.size()]);
            ros::WallDuration(0.02).sleep();
          }
        }) {}
  ~EndlessPlayer() {
    stop_ = true;
    thread_.join();
  }

 private:
  std::atomic<bool> stop_{false};
  std::thread thread_;
};

}  // namespace acmp::test
