#include "progress.h"

#include <algorithm>
#include <cmath>

#include "acmp_mapping/common/classic_locale.h"
#include "acmp_mapping/common/error.h"

namespace acmp {

std::string FormatDuration(double seconds) {
  const auto total = static_cast<long long>(std::llround(std::max(0.0, seconds)));
  if (total < 3600) return StringPrintf("%lld:%02lld", total / 60, total % 60);
  return StringPrintf("%lld:%02lld:%02lld", total / 3600, total / 60 % 60, total % 60);
}

Progress::~Progress() { EraseBar(); }

void Progress::Begin(const std::string& stage, int steps, int reused) {
  const std::lock_guard<std::mutex> lock(mutex_);
  start_ = std::chrono::steady_clock::now();
  stage_ = stage;
  steps_ = std::max(steps, 1);
  step_ = reused_ = reused;
  shown_percent_ = -1;
  Show();
}

void Progress::Step() {
  const std::lock_guard<std::mutex> lock(mutex_);
  ++step_;
  Show();
}

void Progress::Note(const std::string& message) {
  const std::lock_guard<std::mutex> lock(mutex_);
  if (quiet_) return;
  EraseBar();
  log_ << message << std::endl;
}

void Progress::Warn(const std::string& message) {
  if (message.empty()) return;
  const std::lock_guard<std::mutex> lock(mutex_);
  EraseBar();
  log_ << "warning: " << message << std::endl;
}

void Progress::Result(const std::string& message) {
  if (!quiet_) results_ << message << std::endl;
}

double Progress::SecondsLeft(double elapsed_s) const {
  return step_ > reused_ ? elapsed_s / (step_ - reused_) * (steps_ - step_) : -1;
}

void Progress::Show() {
  if (quiet_) return;
  const auto percent = static_cast<int>(int64_t{100} * step_ / steps_);
  if (!has_bar_ && percent == shown_percent_) return;
  shown_percent_ = percent;
  const std::chrono::duration<double> elapsed = std::chrono::steady_clock::now() - start_;
  const double left_s = SecondsLeft(elapsed.count());
  const std::string text = Concat(percent, " %  ", stage_, " ", step_, "/", steps_,
                                  left_s < 0 ? std::string() : Concat("  ", FormatDuration(left_s), " left"));
  if (!has_bar_) {
    log_ << text << std::endl;
    return;
  }
  constexpr int kBarWidth = 30;
  const int filled = percent * kBarWidth / 100;
  log_ << "\r\033[K[" << std::string(filled, '#') << std::string(kBarWidth - filled, '.') << "] " << text << std::flush;
  bar_visible_ = true;
}

void Progress::EraseBar() {
  if (!bar_visible_) return;
  log_ << "\r\033[K" << std::flush;
  bar_visible_ = false;
}

}  // namespace acmp
