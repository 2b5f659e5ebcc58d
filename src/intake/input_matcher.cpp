#include "acmp_mapping/intake/input_matcher.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <utility>

#include "acmp_mapping/common/error.h"
#include "acmp_mapping/geometry/interpolate.h"

namespace acmp {
namespace {

constexpr size_t kPoseCapacity = 20000;            ///< 20 s of a propagator at 1 kHz; 4 MB
constexpr int64_t kSparseToleranceNs = 500000000;  ///< the nearest cloud within is taken, else the last one
constexpr size_t kMoreThanImages = 10;             ///< clouds, masks, depth: those of images that are still to come

int64_t ToNs(double seconds) { return std::llround(seconds * 1e9); }
double ToMs(int64_t ns) { return static_cast<double>(ns) * 1e-6; }

/// The received one whose stamp is nearest, of all or of those that are not used; null: none.
template <class Received>
auto Nearest(Received& received, int64_t stamp_ns, bool unused = false) -> decltype(&received.front()) {
  decltype(&received.front()) nearest = nullptr;
  const auto gap = [&](const auto& r) { return std::llabs(r.stamp_ns - stamp_ns); };
  for (auto& one : received) {
    if (!(unused && one.used) && (!nearest || gap(one) < gap(*nearest))) nearest = &one;
  }
  return nearest;
}

std::string NameOf(size_t stream) {
  constexpr const char* kNames[] = {"mask", "prior depth", "labels"};
  return stream < kSourceStream ? kNames[stream] : Concat("image of source camera ", stream - kSourceStream + 1);
}

std::string DescribeSecondPose(const PoseSample& first, const PoseSample& second) {
  const RigidTransform step = first.received.inverse() * second.received;
  const double degrees = Eigen::AngleAxisd(step.linear()).angle() * 180 / M_PI;
  const bool is_of_same_world = first.world_frame == second.world_frame;
  return Concat("two poses have the stamp ", FormatStamp(first.stamp_ns), "; the second is not used: it lies ",
                step.translation().norm(), " from the first and is turned by ", degrees, " degrees",
                is_of_same_world ? "" : ", in " + second.world_frame + " instead of " + first.world_frame,
                ". Do two programs publish poses?");
}

}  // namespace

InputMatcher::InputMatcher(const InputMatcherOptions& options)
    : options_(options), sync_tolerance_ns_(ToNs(options.sync_tolerance_s)) {
  companions_.resize(kSourceStream);
  companions_.resize(kSourceStream + static_cast<size_t>(options.source_cameras),
                     Companions{std::max(kSameExposureNs, ToNs(options.source_tolerance_s))});
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
  images_.insert(place, WaitingImage{std::move(image)});
  if (images_.size() > static_cast<size_t>(options_.image_capacity)) EvictOldestImage();
}

void InputMatcher::AddPose(PoseSample pose) {
  const int64_t stamp_ns = pose.stamp_ns;
  if (const auto* first = poses_.Find(stamp_ns)) {
    const PoseSample& known = first->sample;
    const bool is_sent_again = known.received.isApprox(pose.received) && known.world_frame == pose.world_frame &&
                               known.child_frame == pose.child_frame;
    if (!is_sent_again) events_.push_back(RejectedInput{"duplicate_pose", DescribeSecondPose(known, pose)});
    return;
  }
  new_poses_ns_.push_back(stamp_ns);
  poses_.Add(stamp_ns, std::move(pose), kPoseCapacity);
}

void InputMatcher::AddCloud(SparseCloudPtr cloud) {
  const int64_t stamp_ns = cloud->stamp_ns;
  clouds_.Add(stamp_ns, std::move(cloud), CompanionCapacity());
}

size_t InputMatcher::CompanionCapacity() const {
  return static_cast<size_t>(options_.image_capacity) + kMoreThanImages;
}

void InputMatcher::AddCompanion(size_t stream, ImageSample sample) {
  const int64_t stamp_ns = sample.stamp_ns;
  if (companions_.at(stream).buffer.Find(stamp_ns)) {
    events_.push_back(RejectedInput{
        "duplicate_companion",
        Concat("two messages with the ", NameOf(stream), " have the stamp ", FormatStamp(stamp_ns),
               ": the first one is used. Where two nodes publish them, as for two mappers, give each its own topic")});
    return;
  }
  companions_.at(stream).buffer.Add(stamp_ns, std::move(sample), CompanionCapacity());
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
  poses_ = {};
  clouds_ = {};
  for (Companions& companions : companions_) companions.buffer = {};
  newest_image_ns_.reset();
  last_match_ns_.reset();
}

void InputMatcher::HandleTimeJump(int64_t stamp_ns) {
  FindPoses(0);
  EmitReady(0, false);
  // What still waits now has waited in vain: that is worth more to the user than that time went back.
  for (const WaitingImage& image : images_) DropWaiting(image);
  images_.clear();
  // What is left of the old run would be poses and landmarks in what may be another world.
  poses_.StartRun(stamp_ns);
  clouds_.StartRun(stamp_ns);
  for (Companions& companions : companions_) companions.buffer.StartRun(stamp_ns);
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
    // Where stamps do not fit, each pose is compared with each image once.
    const auto is_near = [&](int64_t pose_ns) {
      return std::llabs(pose_ns - image.sample.stamp_ns) <= sync_tolerance_ns_;
    };
    const auto& all = poses_.received;
    if (!image.has_near_pose && image.is_searched) {
      image.has_near_pose = std::any_of(new_poses_ns_.begin(), new_poses_ns_.end(), is_near);
    } else if (!image.has_near_pose) {
      image.has_near_pose = std::any_of(all.begin(), all.end(), [&](const auto& p) { return is_near(p.stamp_ns); });
    }
    image.is_searched = true;
    if (image.has_near_pose) image.pose = FindPose(image.sample.stamp_ns);
    if (image.pose) image.ready_since_s = now_s;
  }
  new_poses_ns_.clear();
}

std::optional<PoseSample> InputMatcher::FindPose(int64_t stamp_ns) {
  auto* nearest = Nearest(poses_.received, stamp_ns, true);
  const int64_t gap_ns = nearest ? std::llabs(nearest->stamp_ns - stamp_ns) : INT64_MAX;
  const bool is_same = gap_ns <= std::min(kSameExposureNs, sync_tolerance_ns_);
  std::optional<PoseSample> between = is_same ? std::nullopt : PoseBetween(stamp_ns);
  if (!is_same && !between && !(nearest && PoseIsFinal(stamp_ns, nearest->stamp_ns))) return std::nullopt;
  if (!is_same) pose_use_.farthest_ns = std::max<int64_t>(pose_use_.farthest_ns, std::llabs(*PoseGapOf(stamp_ns)));
  ++(is_same ? pose_use_.same : between ? pose_use_.between : pose_use_.nearest);
  if (between) return between;
  nearest->used = true;
  return nearest->sample;
}

std::optional<PoseSample> InputMatcher::PoseBetween(int64_t stamp_ns) const {
  const StreamBuffer<PoseSample>::Received *before = nullptr, *after = nullptr;
  for (auto pose = poses_.received.rbegin(); pose != poses_.received.rend() && !before; ++pose) {
    (pose->stamp_ns <= stamp_ns ? before : after) = &*pose;
  }
  if (!before || !after || before->sample.world_frame != after->sample.world_frame) return std::nullopt;
  if (stamp_ns - before->stamp_ns > sync_tolerance_ns_ || after->stamp_ns - stamp_ns > sync_tolerance_ns_) {
    return std::nullopt;
  }
  PoseSample pose = before->sample;
  const auto way_ns = static_cast<double>(after->stamp_ns - before->stamp_ns);
  pose.stamp_ns = stamp_ns;
  pose.received = Interpolate(before->sample.received, after->sample.received,
                              static_cast<double>(stamp_ns - before->stamp_ns) / way_ns);
  return pose;
}

std::optional<int64_t> InputMatcher::PoseGapOf(int64_t stamp_ns) const {
  const auto* nearest = Nearest(poses_.received, stamp_ns);
  return nearest ? std::make_optional(nearest->stamp_ns - stamp_ns) : std::nullopt;
}

bool InputMatcher::PoseIsFinal(int64_t image_stamp_ns, int64_t pose_stamp_ns) const {
  const int64_t gap_ns = pose_stamp_ns - image_stamp_ns;
  if (std::llabs(gap_ns) > sync_tolerance_ns_) return false;
  return gap_ns >= -kSameExposureNs || poses_.HasComeFrom(image_stamp_ns);
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
  const int64_t stamp_ns = image.sample.stamp_ns;
  return clouds_.HasComeFrom(stamp_ns - sync_tolerance_ns_, stamp_ns + kSparseToleranceNs, !last_match_ns_);
}

SparseCloudPtr InputMatcher::ChooseCloud(int64_t stamp_ns) const {
  SparseCloudPtr nearest;
  int64_t nearest_gap_ns = kSparseToleranceNs;
  for (const auto& cloud : clouds_.received) {
    const int64_t gap_ns = std::llabs(cloud.stamp_ns - stamp_ns);
    if (gap_ns > nearest_gap_ns) continue;
    nearest = cloud.sample;
    nearest_gap_ns = gap_ns;
  }
  return nearest || clouds_.received.empty() ? nearest : clouds_.received.back().sample;
}

bool InputMatcher::CompanionsAreSettled(const WaitingImage& image, double now_s) const {
  if (now_s - image.ready_since_s >= options_.mask_wait_s) return true;
  const int64_t stamp_ns = image.sample.stamp_ns;
  return std::all_of(companions_.begin(), companions_.end(), [&](const Companions& companions) {
    const int64_t tolerance_ns = companions.tolerance_ns;
    return !companions.expected ||
           companions.buffer.HasComeFrom(stamp_ns - tolerance_ns, stamp_ns + tolerance_ns, !last_match_ns_);
  });
}

RejectedInput InputMatcher::DescribeMissingCompanion(size_t stream, int64_t stamp_ns) const {
  const std::string image = Concat("image ", FormatStamp(stamp_ns));
  const std::string wait = Concat("~mask_wait ", options_.mask_wait_s, " s)");
  constexpr const char* kReasons[] = {"no_mask", "no_prior_depth", "no_labels"};
  if (stream < kSourceStream) {
    const char* use = stream == kMaskStream ? " is used as a whole" : " goes without";
    return {kReasons[stream], Concat(image, use, ": no ", NameOf(stream), " with its stamp came (", wait)};
  }
  return {"no_source_image",
          Concat(image, " goes without: no ", NameOf(stream), " within ", ToMs(ToNs(options_.source_tolerance_s)),
                 " ms of it came (~source_tolerance, ", wait)};
}

void InputMatcher::Emit(WaitingImage image) {
  last_match_ns_ = image.sample.stamp_ns;
  MatchedInput match{std::move(image.sample), std::move(*image.pose), nullptr, std::nullopt, {}};
  for (size_t stream = 0; stream < companions_.size(); ++stream) {
    const Companions& companions = companions_[stream];
    const auto* nearest = Nearest(companions.buffer.received, match.image.stamp_ns);
    const bool is_its = nearest && std::llabs(nearest->stamp_ns - match.image.stamp_ns) <= companions.tolerance_ns;
    match.companions.push_back(is_its ? nearest->sample.image : nullptr);
    if (!is_its && companions.expected) {
      events_.emplace_back(DescribeMissingCompanion(stream, match.image.stamp_ns));
    }
  }
  match.cloud = ChooseCloud(match.image.stamp_ns);
  if (match.cloud) {
    if (std::llabs(match.cloud->stamp_ns - match.image.stamp_ns) <= std::max(sync_tolerance_ns_, kSameExposureNs)) {
      match.cloud_pose = match.pose;
    } else if (auto between = PoseBetween(match.cloud->stamp_ns)) {
      match.cloud_pose = std::move(between);
    } else if (const auto* pose = Nearest(poses_.received, match.cloud->stamp_ns);
               pose && std::llabs(pose->stamp_ns - match.cloud->stamp_ns) <= sync_tolerance_ns_) {
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
  last_gap_ = PoseGap{stamp_ns, PoseGapOf(stamp_ns), image.pose_problem};
  events_.push_back(RejectedInput{"no_pose", DescribeMissingPose(image), true});
}

std::string InputMatcher::DescribeMissingPose(const WaitingImage& image) const {
  const int64_t stamp_ns = image.sample.stamp_ns;
  std::string nearest_text = image.pose_problem.empty() ? "no pose has been received" : image.pose_problem;
  if (const auto gap_ns = PoseGapOf(stamp_ns)) {
    nearest_text = Concat("nearest is ", ToMs(std::llabs(*gap_ns)), " ms away");
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
