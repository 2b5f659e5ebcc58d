#include "acmp_mapping/bags/bag_check.h"

#include <algorithm>
#include <cmath>
#include <iomanip>
#include <map>
#include <set>
#include <sstream>

#include <sensor_msgs/distortion_models.h>
#include <sensor_msgs/image_encodings.h>

#include "bag_rules.h"

namespace acmp {
namespace {

bool IsConvertible(const std::string& encoding) {
  namespace enc = sensor_msgs::image_encodings;
  static const std::set<std::string> others = {enc::YUV422, enc::BGR16, enc::RGB16, enc::BGRA16, enc::RGBA16};
  static const std::set<std::string> usual = {enc::MONO8, enc::MONO16, enc::BGR8, enc::RGB8, enc::BGRA8, enc::RGBA8};
  return usual.count(encoding) > 0 || others.count(encoding) > 0 || enc::isBayer(encoding);
}

bool IsDecodable(const std::string& format) {
  for (const char* name : {"jpeg", "jpg", "png"}) {
    if (format.find(name) != std::string::npos) return true;
  }
  return false;
}

template <class Records>
size_t BackwardSteps(const Records& records) {
  size_t steps = 0;
  for (size_t i = 1; i < records.size(); ++i) steps += records[i].stamp < records[i - 1].stamp ? 1 : 0;
  return steps;
}

template <class Records>
void CheckHeaders(const char* what, const std::string& topic, const Records& records, Findings& findings) {
  const auto count = [&](const auto& predicate) { return std::count_if(records.begin(), records.end(), predicate); };
  const auto unset = count([](const auto& record) { return record.stamp.isZero(); });
  const auto nameless = count([](const auto& record) { return record.frame.empty(); });
  if (unset > 0) findings.Error(what, " ", topic, ": ", unset, " of ", records.size(), " stamps are zero");
  if (nameless > 0) findings.Warn(what, " ", topic, ": ", nameless, " of ", records.size(), " have no frame_id");
  const size_t backward = BackwardSteps(records);
  if (backward > 0) {
    findings.Warn(what, " ", topic, ": time runs backward ", backward,
                  " times; the mapper starts over at each (~on_time_jump)");
  }
}

void CheckDistortion(const CameraInfoRecord& info, const std::string& topic, Findings& findings) {
  namespace models = sensor_msgs::distortion_models;
  static const std::map<std::string, size_t> coefficients = {
      {models::PLUMB_BOB, 4}, {models::RATIONAL_POLYNOMIAL, 8}, {models::EQUIDISTANT, 4}};
  if (info.distortion_model.empty() && info.distortion_size == 0) {
    findings.Warn("camera_info ", topic, ": names no distortion model; the images are taken as undistorted");
    return;
  }
  const auto known = coefficients.find(info.distortion_model);
  if (known == coefficients.end()) {
    findings.Error("camera_info ", topic, ": distortion model \"", info.distortion_model,
                   "\" is unknown; known: plumb_bob, rational_polynomial, equidistant");
  } else if (info.distortion_size != 0 && info.distortion_size < known->second) {
    findings.Error("camera_info ", topic, ": ", info.distortion_size, " distortion coefficients, ", known->first,
                   " needs ", known->second);
  }
}

void CheckIntrinsics(const CameraInfoRecord& info, const std::string& topic, Findings& findings) {
  const bool finite =
      std::isfinite(info.fx) && std::isfinite(info.fy) && std::isfinite(info.cx) && std::isfinite(info.cy);
  if (!finite || info.fx <= 0 || info.fy <= 0) {
    findings.Error("camera_info ", topic, ": K[0] = ", info.fx, ", K[4] = ", info.fy,
                   ": the camera is not calibrated; calibrate it and publish the result");
  } else if (!info.resized && (info.cx < 0 || info.cy < 0 || info.cx > info.width || info.cy > info.height)) {
    findings.Warn("camera_info ", topic, ": principal point ", info.cx, ", ", info.cy, " lies outside the image of ",
                  info.width, "x", info.height, " px");
  }
}

void CheckTopicTypes(const BagContents& contents, Findings& findings) {
  for (const BagTopic& topic : contents.topics) {
    if (!topic.known_definition) {
      findings.Error(topic.name, ": recorded with another definition of ", topic.type, "; convert it with: rosbag fix");
    }
  }
}

void CheckNearAndFar(const BagContents& contents, TopicRole role, const std::string& chosen, const std::string& wanted,
                     const char* option, Findings& findings) {
  if (!wanted.empty()) return;
  std::string others;
  for (const BagTopic& topic : contents.topics) {
    if (topic.role == role && topic.name != chosen) others += " " + topic.name;
  }
  if (!others.empty()) findings.Warn("checked ", chosen, "; there is also", others, "; choose with ", option);
}

}  // namespace

std::string Percent(double share) {
  std::ostringstream text;
  text << std::fixed << std::setprecision(1) << 100 * share << " %";
  return text.str();
}

std::vector<double> NearestGaps(const std::vector<ros::Time>& stamps, const std::vector<ros::Time>& others) {
  std::vector<double> gaps;
  for (const ros::Time& stamp : stamps) {
    const auto after = std::lower_bound(others.begin(), others.end(), stamp);
    double gap = std::numeric_limits<double>::infinity();
    if (after != others.end()) gap = (*after - stamp).toSec();
    if (after != others.begin()) gap = std::min(gap, (stamp - *std::prev(after)).toSec());
    gaps.push_back(gap);
  }
  return gaps;
}

void CheckImages(const BagContents& contents, Findings& findings) {
  const std::string& topic = contents.chosen.image;
  const std::vector<ImageRecord>& images = contents.images;
  if (images.empty()) {
    findings.Error("no images: the bag has no sensor_msgs/Image or CompressedImage messages that can be read");
    return;
  }
  std::set<std::string> encodings;
  std::set<std::pair<uint32_t, uint32_t>> sizes;
  size_t incomplete = 0;
  for (const ImageRecord& image : images) {
    encodings.insert(image.encoding);
    if (!image.compressed) sizes.insert({image.width, image.height});
    incomplete += image.complete ? 0 : 1;
  }
  for (const std::string& encoding : encodings) {
    const bool usable = images.front().compressed ? IsDecodable(encoding) : IsConvertible(encoding);
    if (!usable)
      findings.Error("images ", topic, ": encoding \"", encoding, "\" cannot be converted to colour or grey");
  }
  if (incomplete > 0) findings.Error("images ", topic, ": ", incomplete, " have fewer bytes than their size asks for");
  if (sizes.size() > 1) findings.Warn("images ", topic, ": ", sizes.size(), " different sizes");
  constexpr size_t kFewestImages = 3;  // a keyframe waits for two source views
  if (images.size() < kFewestImages) findings.Error("images ", topic, ": only ", images.size(), ", at least 3 needed");
  CheckHeaders("images", topic, images, findings);
  const ImageRecord& first = images.front();
  const std::string size = first.compressed ? "" : Concat(", ", first.width, "x", first.height, " px");
  findings.Ok("images ", topic, ": ", images.size(), ", ", first.encoding, size, ", frame \"", first.frame, "\"");
}

void CheckCameraInfo(const BagContents& contents, Findings& findings) {
  const std::string& topic = contents.chosen.camera_info;
  if (contents.camera_infos.empty()) {
    findings.Error("no camera_info: the mapper needs sensor_msgs/CameraInfo with the images");
    return;
  }
  const CameraInfoRecord& info = contents.camera_infos.front();
  CheckIntrinsics(info, topic, findings);
  CheckDistortion(info, topic, findings);
  std::set<std::vector<double>> variants;
  for (const CameraInfoRecord& other : contents.camera_infos) variants.insert({other.fx, other.fy, other.cx, other.cy});
  if (variants.size() > 1) findings.Warn("camera_info ", topic, ": K changes, ", variants.size(), " variants");
  for (const ImageRecord& image : contents.images) {
    if (image.compressed || (image.width == info.width && image.height == info.height)) continue;
    findings.Error("camera_info ", topic, ": is for ", info.width, "x", info.height, " px, an image has ", image.width,
                   "x", image.height);
    break;
  }
  if (info.resized) findings.Ok("camera_info ", topic, ": has binning or a region of interest");
  findings.Ok("camera_info ", topic, ": fx ", info.fx, ", fy ", info.fy, ", ",
              info.distortion_model.empty() ? "no distortion model" : info.distortion_model);
}

size_t BagReport::Count(Severity severity) const {
  return std::count_if(findings.begin(), findings.end(),
                       [severity](const Finding& finding) { return finding.severity == severity; });
}

BagReport CheckBag(const std::filesystem::path& path, const BagCheckOptions& options) {
  BagReport report;
  report.contents = ReadBagContents(path, options.topics);
  const BagContents& contents = report.contents;
  const TopicChoice& chosen = contents.chosen;
  const TopicChoice& wanted = options.topics;
  Findings findings;
  CheckTopicTypes(contents, findings);
  CheckNearAndFar(contents, TopicRole::kImage, chosen.image, wanted.image, "--image", findings);
  CheckNearAndFar(contents, TopicRole::kCameraInfo, chosen.camera_info, wanted.camera_info, "--camera-info", findings);
  CheckNearAndFar(contents, TopicRole::kPose, chosen.pose, wanted.pose, "--pose", findings);
  CheckNearAndFar(contents, TopicRole::kSparsePoints, chosen.sparse_points, wanted.sparse_points, "--sparse-points",
                  findings);
  CheckImages(contents, findings);
  CheckCameraInfo(contents, findings);
  CheckPoses(contents, options, findings);
  CheckClouds(contents, options, findings);
  if (!chosen.pose.empty()) CheckHeaders("poses", chosen.pose, contents.poses, findings);
  report.findings = findings.Take();
  return report;
}

}  // namespace acmp
