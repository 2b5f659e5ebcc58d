#pragma once

#include <fstream>
#include <nlohmann/json.hpp>
#include <set>
#include <string>
#include <vector>

#include "reconstruction/run_fixture.h"

namespace acmp {

/// A run that is done in stages of chunks.
class StagesFixture : public ReconstructRunFixture {
 protected:
  static constexpr int kStreetImages = 9;

  /// Nine images, each matched against its two neighbours on either side; chunks of two.
  StagesFixture() {
    WriteScene(kStreetImages, kWidth, kHeight);
    std::string pairs = std::to_string(kStreetImages) + "\n";
    for (int i = 0; i < kStreetImages; ++i) {
      std::string sources;
      int count = 0;
      for (int j = 0; j < kStreetImages; ++j) {
        if (j == i || std::abs(j - i) > 2) continue;
        sources += " " + std::to_string(j) + " 1";
        ++count;
      }
      pairs += std::to_string(i) + "\n" + std::to_string(count) + sources + "\n";
    }
    WriteText("scene/pair.txt", pairs);
    options_.chunk_images = 2;
  }

  struct Task {
    std::string stage, images;
    std::vector<int> after;
  };

  int RunAlone() {
    FakeMatcher fake;
    options_.output = output("alone");
    Run(&fake);
    options_.output = output();
    return static_cast<int>(fake.calls.size());
  }

  nlohmann::json PlanFile() {
    options_.plan = folder() / "plan.json";
    Run(&fake_);
    options_.plan.clear();
    std::ifstream stream(folder() / "plan.json");
    return nlohmann::json::parse(stream);
  }
  std::vector<Task> Plan() {
    std::vector<Task> tasks;
    const nlohmann::json plan = PlanFile();
    for (const nlohmann::json& task : plan.at("tasks")) {
      tasks.push_back({task.at("stage"), task.at("images"), task.at("after").get<std::vector<int>>()});
    }
    return tasks;
  }

  void Stage(const std::string& stage, const std::string& images, FakeMatcher* matcher,
             StopRequest* watcher = nullptr) {
    options_.stage = stage;
    options_.images = images;
    try {
      Run(matcher, watcher == nullptr ? &watcher_ : watcher);
    } catch (...) {
      options_.stage.clear();
      options_.images.clear();
      throw;
    }
    options_.stage.clear();
    options_.images.clear();
  }
  void Stage(const Task& task, FakeMatcher* matcher) { Stage(task.stage, task.images, matcher); }

  /// All that is left when `done` are; in the reverse of the plan's order as far as that is allowed.
  void DoAll(const std::vector<Task>& tasks, std::set<int> done, FakeMatcher* matcher) {
    while (done.size() < tasks.size()) {
      for (int i = static_cast<int>(tasks.size()) - 1; i >= 0; --i) {
        const Task& task = tasks[static_cast<size_t>(i)];
        bool ready = done.count(i) == 0;
        for (int other : task.after) ready = ready && done.count(other) > 0;
        if (!ready) continue;
        Stage(task, matcher);
        done.insert(i);
      }
    }
  }

  void ChangeImage1() {
    std::filesystem::copy_file(scene() / "images/00000000.png", scene() / "images/00000001.png",
                               std::filesystem::copy_options::overwrite_existing);
  }

  std::string StageError(const std::string& stage, const std::string& images) {
    return MessageOf<InvalidInputError>([&] { Stage(stage, images, &fake_); });
  }
};

}  // namespace acmp
