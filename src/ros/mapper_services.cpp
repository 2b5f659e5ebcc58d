#include "acmp_mapping/ros/mapper_services.h"

#include <exception>
#include <utility>

#include "acmp_mapping/ros/topic_names.h"

namespace acmp {

MapperServices::MapperServices(ros::NodeHandle private_nh, double period_s, Handlers handlers)
    : handlers_(std::move(handlers)) {
  using TriggerCallback = boost::function<bool(Trigger::Request&, Trigger::Response&)>;
  const auto advertise = [&](const char* name, const std::function<std::string()>& handler) {
    if (!handler) return ros::ServiceServer();
    const TriggerCallback callback = [this, &handler](Trigger::Request&, Trigger::Response& response) {
      return Run(handler, &response);
    };
    return private_nh.advertiseService(name, callback);
  };
  flush_ = advertise(names::kFlush, handlers_.flush);
  reset_ = advertise(names::kReset, handlers_.reset);
  publish_map_ = advertise(names::kPublishMap, handlers_.publish_map);
  using SetBool = std_srvs::SetBool;
  if (handlers_.pause) {
    pause_ =
        private_nh.advertiseService(names::kPause, boost::function<bool(SetBool::Request&, SetBool::Response&)>(
                                                       [this](SetBool::Request& request, SetBool::Response& response) {
                                                         response.message = handlers_.pause(request.data);
                                                         response.success = true;
                                                         return true;
                                                       }));
  }
  using acmp_mapping::SaveMap;
  save_map_ =
      private_nh.advertiseService(names::kSaveMap, boost::function<bool(SaveMap::Request&, SaveMap::Response&)>(
                                                       [this](SaveMap::Request& request, SaveMap::Response& response) {
                                                         try {
                                                           response.points = handlers_.save_map(request);
                                                           response.success = true;
                                                           response.message = "saved to " + request.path;
                                                         } catch (const std::exception& error) {
                                                           response.success = false;
                                                           response.message = error.what();
                                                         }
                                                         return true;
                                                       }));
  timer_ = private_nh.createWallTimer(ros::WallDuration(period_s),
                                      [this](const ros::WallTimerEvent&) { handlers_.periodic(); });
}

bool MapperServices::Run(const std::function<std::string()>& handler, Trigger::Response* response) const {
  try {
    response->message = handler();
    response->success = true;
  } catch (const std::exception& error) {
    response->success = false;
    response->message = error.what();
  }
  return true;
}

}  // namespace acmp
