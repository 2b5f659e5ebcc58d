#include "acmp_mapping/intake/input_matcher.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "acmp_mapping/common/error.h"

namespace acmp {
namespace {

constexpr size_t kPoseCapacity = 2000;  ///< 10 s of a 200 Hz source

int64_t ToNs(double seconds) { return std::llround(seconds * 1e9); }
double ToMs(int64_t ns) { return static_cast<double>(ns) * 1e-6; }

}  // namespace

void Validate(const InputMatcherOptions& options) {
  CheckRange("sync_tolerance", options.sync_tolerance_s, 0.0, 10.0);
  CheckRange("sparse_tolerance", options.sparse_tolerance_s, 0.0, 1000.0);
  CheckRange("sparse_wait", options.sparse_wait_s, 0.0, 10.0);
  CheckRange("mask_wait", options.mask_wait_s, 0.0, 10.0);
  CheckRange("image_capacity", options.image_capacity, 1, 1000);
  CheckRange("source_cameras", options.source_cameras, 0, kMaxSourceCameras);
  CheckRange("source_tolerance", options.source_tolerance_s, 0.0, 0.1);
}

InputMatcher::InputMatcher(const InputMatcherOptions& options)
    : options_(options),
      sync_tolerance_ns_(ToNs(options.sync_tolerance_s)),
      sparse_tolerance_ns_(ToNs(options.sparse_tolerance_s)) {
  Validate(options);
  source_images_.assign(static_cast<size_t>(options.source_cameras),
                        CompanionImages(std::max(kSameExposureNs, ToNs(options.source_tolerance_s))));
}

void InputMatcher::AddImage(ImageSample image) {
  const int64_t stamp_ns = image.stamp_ns;
  if (newest_image_ns_ && stamp_ns < *newest_image_ns_ - kTimeJumpNs) HandleTimeJump(stamp_ns);
  newest_image_ns_ = std::max(stamp_ns, newest_image_ns_.value_or(stamp_ns));

  if (last_match_ns_ && stamp_ns <= *last_match_ns_) {
    const char* reason = stamp_ns == *last_match_ns_ ? "duplicate_image" : "late_image";
    events_.push_back(RejectedInput{
        reason,
        Concat("image ", FormatStamp(stamp_ns), " came after image ", FormatStamp(*last_match_ns_), " was used"),
        true});
    return;
  }
  const auto place = std::upper_bound(images_.begin(), images_.end(), stamp_ns,
                                      [](int64_t s, const WaitingImage& w) { return s < w.sample.stamp_ns; });
  if (place != images_.begin() && std::prev(place)->sample.stamp_ns == stamp_ns) {
    events_.push_back(
        RejectedInput{"duplicate_image", Concat("two images have the stamp ", FormatStamp(stamp_ns)), true});
    return;
  }
  images_.insert(place, WaitingImage{std::move(image), std::nullopt, -1, {}});
  if (images_.size() > static_cast<size_t>(options_.image_capacity)) EvictOldestImage();
}

void InputMatcher::AddPose(PoseSample pose) {
  const uint64_t arrival = ++arrivals_;
  const int64_t stamp_ns = pose.stamp_ns;
  if (pose_runs_.Add(stamp_ns, arrival)) poses_.clear();
  const auto place = std::upper_bound(poses_.begin(), poses_.end(), stamp_ns,
                                      [](int64_t s, const ReceivedPose& p) { return s < p.sample.stamp_ns; });
  poses_.insert(place, ReceivedPose{std::move(pose), false, arrival});
  if (poses_.size() > kPoseCapacity) poses_.pop_front();
}

void InputMatcher::AddCloud(SparseCloudPtr cloud) {
  const uint64_t arrival = ++arrivals_;
  if (cloud_runs_.Add(cloud->stamp_ns, arrival)) clouds_.clear();
  clouds_.push_back({std::move(cloud), arrival});
  if (clouds_.size() > CompanionCapacity()) clouds_.pop_front();
}

size_t InputMatcher::CompanionCapacity() const {
  return static_cast<size_t>(options_.image_capacity) + kMoreThanImages;
}

void InputMatcher::AddMask(CompanionSample mask) { masks_.Add(std::move(mask), ++arrivals_, CompanionCapacity()); }

void InputMatcher::AddPriorDepth(CompanionSample depth) {
  prior_depths_.Add(std::move(depth), ++arrivals_, CompanionCapacity());
}

void InputMatcher::AddSourceImage(size_t camera, CompanionSample image) {
  source_images_.at(camera).Add(std::move(image), ++arrivals_, CompanionCapacity());
}

std::vector<MatchEvent> InputMatcher::Take(double now_s) {
  FindPoses(now_s);
  EmitReady(now_s, true);
  return std::exchange(events_, {});
}

std::vector<MatchEvent> InputMatcher::TakeAll() {
  FindPoses(0);
  EmitReady(0, false);
  return std::exchange(events_, {});
}

void InputMatcher::Clear(const std::string& reason) {
  for (const WaitingImage& image : images_) {
    events_.push_back(RejectedInput{
        reason, Concat("image ", FormatStamp(image.sample.stamp_ns), " was waiting (", reason, ")"), true});
  }
  images_.clear();
  poses_.clear();
  clouds_.clear();
  masks_.Clear();
  prior_depths_.Clear();
  for (CompanionImages& images : source_images_) images.Clear();
  newest_image_ns_.reset();
  last_match_ns_.reset();
  pose_runs_ = cloud_runs_ = TimeJumpTracker();
}

void InputMatcher::HandleTimeJump(int64_t stamp_ns) {
  FindPoses(0);
  EmitReady(0, false);
  // What still waits now has waited in vain: that is worth more to the user than that time went back.
  for (const WaitingImage& image : images_) DropWaiting(image);
  images_.clear();
  // What is left of the old run would be poses and landmarks in what may be another world.
  KeepNewRun(stamp_ns, &pose_runs_, &poses_);
  KeepNewRun(stamp_ns, &cloud_runs_, &clouds_);
  masks_.StartRun(stamp_ns);
  prior_depths_.StartRun(stamp_ns);
  for (CompanionImages& images : source_images_) images.StartRun(stamp_ns);
  events_.push_back(TimeJump{*newest_image_ns_, stamp_ns});
  newest_image_ns_.reset();
  last_match_ns_.reset();
}

void InputMatcher::EvictOldestImage() {
  WaitingImage image = std::move(images_.front());
  images_.pop_front();
  if (image.pose && !obstacle_) {
    Emit(std::move(image));
  } else {
    DropWaiting(image);
  }
}

std::vector<int64_t> InputMatcher::UnposedStamps() const {
  std::vector<int64_t> stamps;
  for (const WaitingImage& image : images_) {
    if (!image.pose) stamps.push_back(image.sample.stamp_ns);
  }
  return stamps;
}

void InputMatcher::SetPoseProblem(int64_t stamp_ns, const std::string& problem) {
  for (WaitingImage& image : images_) {
    if (image.sample.stamp_ns == stamp_ns) image.pose_problem = problem;
  }
}

void InputMatcher::FindPoses(double now_s) {
  for (WaitingImage& image : images_) {
    if (image.pose) continue;
    ReceivedPose* nearest = NearestUnusedPose(image.sample.stamp_ns);
    if (!nearest || !PoseIsFinal(image.sample.stamp_ns, nearest->sample.stamp_ns)) continue;
    nearest->used = true;
    image.pose = nearest->sample;
    image.ready_since_s = now_s;
  }
}

InputMatcher::ReceivedPose* InputMatcher::NearestUnusedPose(int64_t stamp_ns) {
  ReceivedPose* nearest = nullptr;
  for (ReceivedPose& pose : poses_) {
    if (!pose.used && (!nearest || Gap(pose, stamp_ns) < Gap(*nearest, stamp_ns))) nearest = &pose;
  }
  return nearest;
}

const InputMatcher::ReceivedPose* InputMatcher::NearestPose(int64_t stamp_ns) const {
  const auto nearest = std::min_element(
      poses_.begin(), poses_.end(), [&](const auto& a, const auto& b) { return Gap(a, stamp_ns) < Gap(b, stamp_ns); });
  return nearest == poses_.end() ? nullptr : &*nearest;
}

bool InputMatcher::PoseIsFinal(int64_t image_stamp_ns, int64_t pose_stamp_ns) const {
  const int64_t gap_ns = pose_stamp_ns - image_stamp_ns;
  if (std::llabs(gap_ns) > sync_tolerance_ns_) return false;
  return gap_ns >= -kSameExposureNs || pose_runs_.newest_ns() >= image_stamp_ns;
}

void InputMatcher::EmitReady(double now_s, bool wait) {
  if (obstacle_) return;
  for (;;) {
    const auto ready = std::find_if(images_.begin(), images_.end(), [](const WaitingImage& i) { return i.pose; });
    if (ready == images_.end()) return;
    if (wait && !(CloudIsSettled(*ready, now_s) && CompanionsAreSettled(*ready, now_s))) return;
    std::for_each(images_.begin(), ready, [this](const WaitingImage& overtaken) { DropUnposed(overtaken); });
    WaitingImage image = std::move(*ready);
    images_.erase(images_.begin(), std::next(ready));
    Emit(std::move(image));
  }
}

bool InputMatcher::CloudIsSettled(const WaitingImage& image, double now_s) const {
  if (!clouds_expected_ || now_s - image.ready_since_s >= options_.sparse_wait_s) return true;
  const int64_t earliest_ns = image.sample.stamp_ns - sync_tolerance_ns_;
  // One of the run before, which came after the first image of this one, tells nothing of that image's.
  const bool may_be_old = cloud_runs_.is_behind() && !last_match_ns_;
  const int64_t latest_ns = may_be_old ? image.sample.stamp_ns + sparse_tolerance_ns_ : INT64_MAX;
  return std::any_of(clouds_.begin(), clouds_.end(), [&](const ReceivedCloud& c) {
    return c.cloud->stamp_ns >= earliest_ns && c.cloud->stamp_ns <= latest_ns;
  });
}

SparseCloudPtr InputMatcher::ChooseCloud(int64_t stamp_ns) const {
  SparseCloudPtr nearest;
  int64_t nearest_gap_ns = sparse_tolerance_ns_;
  for (const ReceivedCloud& received : clouds_) {
    const int64_t gap_ns = std::llabs(received.cloud->stamp_ns - stamp_ns);
    if (gap_ns > nearest_gap_ns) continue;
    nearest = received.cloud;
    nearest_gap_ns = gap_ns;
  }
  if (nearest || clouds_.empty()) return nearest;
  return clouds_.back().cloud;
}

bool InputMatcher::CompanionsAreSettled(const WaitingImage& image, double now_s) const {
  if (now_s - image.ready_since_s >= options_.mask_wait_s) return true;
  const bool is_first = !last_match_ns_;
  const auto is_settled = [&](const CompanionImages& images) {
    return images.IsSettled(image.sample.stamp_ns, is_first);
  };
  return is_settled(masks_) && is_settled(prior_depths_) &&
         std::all_of(source_images_.begin(), source_images_.end(), is_settled);
}

void InputMatcher::Emit(WaitingImage image) {
  last_match_ns_ = image.sample.stamp_ns;
  MatchedInput match{std::move(image.sample), std::move(*image.pose), nullptr, std::nullopt, nullptr, nullptr, {}};
  match.mask = masks_.Find(match.image.stamp_ns);
  match.prior_depth = prior_depths_.Find(match.image.stamp_ns);
  if (masks_.expected() && !match.mask) {
    events_.push_back(RejectedInput{"no_mask", Concat("image ", FormatStamp(match.image.stamp_ns),
                                                      " is used as a whole: no mask with its stamp came (~mask_wait ",
                                                      options_.mask_wait_s, " s)")});
  }
  if (prior_depths_.expected() && !match.prior_depth) {
    events_.push_back(RejectedInput{"no_prior_depth", Concat("image ", FormatStamp(match.image.stamp_ns),
                                                             " goes without: no prior depth with its "
                                                             "stamp came (~mask_wait ",
                                                             options_.mask_wait_s, " s)")});
  }
  for (size_t camera = 0; camera < source_images_.size(); ++camera) {
    match.source_images.push_back(source_images_[camera].Find(match.image.stamp_ns));
    if (match.source_images.back() || !source_images_[camera].expected()) continue;
    events_.push_back(RejectedInput{
        "no_source_image", Concat("image ", FormatStamp(match.image.stamp_ns), " goes without source camera ",
                                  camera + 1, ": no image within ", ToMs(ToNs(options_.source_tolerance_s)),
                                  " ms of it came (~source_tolerance, ~mask_wait ", options_.mask_wait_s, " s)")});
  }
  match.cloud = ChooseCloud(match.image.stamp_ns);
  if (match.cloud) {
    if (std::llabs(match.cloud->stamp_ns - match.image.stamp_ns) <= std::max(sync_tolerance_ns_, kSameExposureNs)) {
      match.cloud_pose = match.pose;
    } else if (const ReceivedPose* pose = NearestPose(match.cloud->stamp_ns);
               pose && std::llabs(pose->sample.stamp_ns - match.cloud->stamp_ns) <= sync_tolerance_ns_) {
      match.cloud_pose = pose->sample;
    }
  }
  events_.emplace_back(std::move(match));
}

void InputMatcher::DropWaiting(const WaitingImage& image) {
  if (!obstacle_) return DropUnposed(image);
  events_.push_back(RejectedInput{
      obstacle_->reason, Concat("image ", FormatStamp(image.sample.stamp_ns), ": ", obstacle_->message), true});
}

void InputMatcher::DropUnposed(const WaitingImage& image) {
  const int64_t stamp_ns = image.sample.stamp_ns;
  last_gap_ = PoseGap{stamp_ns, std::nullopt, image.pose_problem};
  if (const ReceivedPose* nearest = NearestPose(stamp_ns)) last_gap_->gap_ns = nearest->sample.stamp_ns - stamp_ns;
  events_.push_back(RejectedInput{"no_pose", DescribeMissingPose(image), true});
}

std::string InputMatcher::DescribeMissingPose(const WaitingImage& image) const {
  const int64_t stamp_ns = image.sample.stamp_ns;
  std::string nearest_text = image.pose_problem.empty() ? "no pose has been received" : image.pose_problem;
  if (const ReceivedPose* nearest = NearestPose(stamp_ns)) {
    nearest_text = Concat("nearest is ", ToMs(Gap(*nearest, stamp_ns)), " ms away");
  }
  return Concat("no pose within ", ToMs(sync_tolerance_ns_), " ms of image ", FormatStamp(stamp_ns), "; ",
                nearest_text);
}

std::optional<InputMatcher::PoseWait> InputMatcher::longest_pose_wait() const {
  const auto oldest = std::find_if(images_.begin(), images_.end(), [](const WaitingImage& i) { return !i.pose; });
  if (oldest == images_.end()) return std::nullopt;
  return PoseWait{oldest->sample.arrival_s, DescribeMissingPose(*oldest)};
}

}  // namespace acmp
