#pragma once

#include <functional>
#include <string>

#include <ros/node_handle.h>

namespace acmp {

/// A Trigger service. The handler returns what it did; an exception's text becomes the message of a failure. Handlers
/// may take as long as a map takes to write: give them a thread of their own.
ros::ServiceServer AdvertiseTrigger(ros::NodeHandle nh, const char* name, std::function<std::string()> handler);

}  // namespace acmp
