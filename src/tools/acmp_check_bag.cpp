// acmp_check_bag: says what a bag lacks, or has wrong, for the mapper.

#include <algorithm>
#include <iomanip>
#include <iostream>
#include <string>

#include "acmp_mapping/bags/bag_check.h"
#include "tool_main.h"

namespace {

const char* RoleOf(const acmp::BagTopic& topic, const acmp::TopicChoice& chosen) {
  if (topic.name == chosen.image) return "image";
  if (topic.name == chosen.camera_info) return "camera_info";
  if (topic.name == chosen.pose) return "pose";
  if (topic.name == chosen.sparse_points) return "sparse_points";
  if (topic.name == chosen.mask) return "mask";
  if (topic.name == chosen.labels) return "labels";
  const auto is_one_of = [&](const auto& names) {
    return std::find(names.begin(), names.end(), topic.name) != names.end();
  };
  if (is_one_of(chosen.source_images)) return "source_image";
  if (is_one_of(chosen.source_camera_infos)) return "source_camera_info";
  return "";
}

void PrintTopics(const acmp::BagReport& report) {
  size_t widest = 0;
  for (const acmp::BagTopic& topic : report.topics) widest = std::max(widest, topic.name.size());
  std::cout << "topics:\n" << std::left << std::fixed << std::setprecision(1);
  for (const acmp::BagTopic& topic : report.topics) {
    std::cout << "  " << std::setw(static_cast<int>(widest)) << topic.name << "  " << std::setw(32) << topic.type << " "
              << std::setw(6) << topic.messages;
    if (topic.messages > 1 && topic.duration_s > 0) {
      std::cout << " " << static_cast<double>(topic.messages - 1) / topic.duration_s << " Hz";
    }
    std::cout << "  " << RoleOf(topic, report.chosen) << '\n';
  }
}

const char* NameOf(acmp::Severity severity) {
  switch (severity) {
    case acmp::Severity::kOk:
      return "ok";
    case acmp::Severity::kWarning:
      return "warning";
    case acmp::Severity::kError:
      return "error";
  }
  return "";
}

int PrintReport(const acmp::BagReport& report) {
  PrintTopics(report);
  std::cout << "findings:\n";
  for (const acmp::Finding& finding : report.findings) {
    std::cout << "  " << std::setw(8) << NameOf(finding.severity) << finding.message << '\n';
  }
  if (!report.launch.empty()) std::cout << "start the mapper with:\n  " << report.launch << '\n';
  const size_t errors = report.Count(acmp::Severity::kError);
  const size_t warnings = report.Count(acmp::Severity::kWarning);
  std::cout << (report.usable() ? "usable" : "not usable") << ": " << errors << " errors, " << warnings
            << " warnings\n";
  return report.usable() ? acmp::Printed() : acmp::kExitBadInput;
}

}  // namespace

// NOLINTNEXTLINE(bugprone-exception-escape): only a wrong table of options or no memory throw outside RunTool
int main(int argc, char** argv) {
  CLI::App app(
      "Plays a recording to the mapper's own inputs and checks, maps its first keyframes at a small size, and prints\n"
      "what the mapper says: what it takes and drops and why, how poses are meant, where cameras lie. Exit codes: 0 "
      "usable\n"
      "(warnings say what to set), 2 not usable or wrong use, 1 failed.",
      "acmp_check_bag");
  std::vector<std::filesystem::path> bags;
  acmp::BagCheckOptions options;
  app.add_option("bag", bags, "Recorded bag, or all of one recording (rosbag record --split)")
      ->required()
      ->type_name("FILE...");
  app.add_option("--image", options.topics.image, "Image topic; found by type when not given")->type_name("TOPIC");
  app.add_option("--camera-info", options.topics.camera_info, "CameraInfo topic")->type_name("TOPIC");
  app.add_option("--pose", options.topics.pose, "Pose, odometry or transform topic")->type_name("TOPIC");
  app.add_option("--sparse-points", options.topics.sparse_points, "Sparse points")->type_name("TOPIC");
  app.add_option("--mask", options.topics.mask, "Masks, mono8; by default the Image topic named ...mask")
      ->type_name("TOPIC");
  app.add_option("--labels", options.topics.labels, "Classes of pixels; by default the Image topic named ...labels")
      ->type_name("TOPIC");
  app.add_option("--source-image", options.topics.source_images,
                 "Images of source cameras, as the mapper's source_image")
      ->type_name("TOPIC");
  app.add_option("--source-camera-info", options.topics.source_camera_infos, "Theirs, in the same order")
      ->type_name("TOPIC");
  const acmp::OptionList of_mapper = acmp::OptionsOf(&options.mapper);
  for (const char* flag : {"--sync-tolerance", "--pose-is", "--pose-child", "--sparse-frame", "--calibration-file"}) {
    std::string name = flag + 2;
    std::replace(name.begin(), name.end(), '-', '_');
    acmp::Option option = of_mapper.Find(name);
    option.sentence = "As the mapper's ~" + name + ": " + option.sentence;
    option.name = flag;
    option.group.clear();
    AddOption(option, &app);
  }
  app.get_option("--pose-child")->default_str("camera_optical; what images, or frames and tf, say");
  app.get_option("--calibration-file")->type_name("FILE")->default_str("");
  return acmp::RunTool(app, argc, argv, [&] { return PrintReport(acmp::CheckBags(bags, options)); });
}
