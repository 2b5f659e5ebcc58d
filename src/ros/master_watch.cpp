#include "acmp_mapping/ros/master_watch.h"

#include <cstdint>
#include <utility>

#include <ros/connection_manager.h>
#include <ros/master.h>
#include <ros/network.h>
#include <ros/this_node.h>
#include <ros/xmlrpc_manager.h>
#include <xmlrpcpp/XmlRpcClient.h>

#include "acmp_mapping/common/error.h"

namespace acmp {
namespace {

using XmlRpc::XmlRpcValue;

/// A new master often comes with new processes. One of this one's name goes first: its clients must not find this one.
constexpr int kChecksForOthers = 5;
constexpr int kChecksPerReading = 5;  ///< subscriptions of other nodelets in the process may come and go

/// A call of the master's API; false if it cannot be reached or refuses. Does not wait for a master.
bool Ask(const std::string& method, const std::vector<std::string>& arguments, XmlRpcValue* payload) {
  XmlRpcValue request, response;
  request[0] = ros::this_node::getName();
  for (size_t i = 0; i < arguments.size(); ++i) request[static_cast<int>(i) + 1] = arguments[i];
  return ros::master::execute(method, request, response, *payload, false);
}

/// Names in one part of the master's system state that belong to this process.
std::vector<std::string> OwnNames(XmlRpcValue part) {
  std::vector<std::string> names;
  for (int i = 0; i < part.size(); ++i) {
    XmlRpcValue nodes = part[i][1];
    bool own = false;
    for (int k = 0; k < nodes.size(); ++k) own = own || std::string(nodes[k]) == ros::this_node::getName();
    if (own) names.push_back(part[i][0]);
  }
  return names;
}

/// Tells this process who publishes a topic, as the master does when publishers come and go.
void UpdatePublishers(const std::string& topic, const XmlRpcValue& publishers) {
  const ros::XMLRPCManagerPtr manager = ros::XMLRPCManager::instance();
  std::string host;
  uint32_t port = 0;
  if (!ros::network::splitURI(manager->getServerURI(), host, port)) return;
  XmlRpc::XmlRpcClient* client = manager->getXMLRPCClient(host, static_cast<int>(port), "/");
  XmlRpcValue request, response;
  request[0] = "/master";
  request[1] = topic;
  request[2] = publishers;
  client->execute("publisherUpdate", request, response);
  manager->releaseXMLRPCClient(client);
}

}  // namespace

MasterWatch::MasterWatch(const ros::NodeHandle& nh, std::function<void(const std::string&)> report)
    : thread_([report](const std::string& text) { report("the ROS master's answer cannot be read: " + text); }),
      report_(std::move(report)),
      timer_(thread_.MakeTimer(nh, 1.0, [this] { Check(); })) {}

void MasterWatch::Check() {
  XmlRpcValue payload;
  if (!Ask("getPid", {}, &payload)) {
    if (reachable_) report_("the ROS master cannot be reached: what is connected goes on, and the map is kept");
    reachable_ = false;
    return;
  }
  const int pid = payload;
  const bool restarted = master_pid_ != 0 && pid != master_pid_;
  checks_of_new_ = restarted ? checks_of_new_ + 1 : 0;
  if (restarted && checks_of_new_ <= kChecksForOthers) return;
  if (restarted && !Register()) return;  // there is another of this name, or it went again: another time
  if (restarted) {
    report_(Concat("the ROS master was restarted: ", publications_.size() + subscriptions_.size(), " topics and ",
                   services_.size(), " services are registered again; the map is kept"));
  } else if (!reachable_) {
    report_("the ROS master is reached again");
  }
  reachable_ = true;
  master_pid_ = pid;
  if (!restarted && checks_++ % kChecksPerReading == 0) ReadRegistrations();
}

bool MasterWatch::IsReplaced() {
  XmlRpcValue uri;
  const bool replaced = Ask("lookupNode", {ros::this_node::getName()}, &uri) &&
                        std::string(uri) != ros::XMLRPCManager::instance()->getServerURI();
  if (replaced && !replaced_) {
    report_(Concat("the ROS master was restarted, and another ", ros::this_node::getName(), " has registered with it (",
                   std::string(uri), "): this one stays unregistered until that one has ended"));
  }
  return replaced_ = replaced;
}

void MasterWatch::ReadRegistrations() {
  XmlRpcValue state, types;
  if (!Ask("getSystemState", {}, &state) || !Ask("getTopicTypes", {}, &types)) return;
  std::map<std::string, std::string> type_of;
  for (int i = 0; i < types.size(); ++i) type_of[types[i][0]] = std::string(types[i][1]);
  publications_.clear();
  for (const std::string& topic : OwnNames(state[0])) publications_[topic] = type_of[topic];
  subscriptions_ = OwnNames(state[1]);
  services_ = OwnNames(state[2]);
}

bool MasterWatch::Register() {
  const std::string uri = ros::XMLRPCManager::instance()->getServerURI();
  const std::string service_uri =
      Concat("rosrpc://", ros::network::getHost(), ":", ros::ConnectionManager::instance()->getTCPPort());
  XmlRpcValue payload;
  // Another process of the same name may come at any time, and the master would end it at the next registration.
  const auto add = [&](const char* method, const std::vector<std::string>& arguments) {
    return !IsReplaced() && Ask(method, arguments, &payload);
  };
  for (const auto& [topic, type] : publications_) {
    if (!add("registerPublisher", {topic, type, uri})) return false;
  }
  for (const std::string& service : services_) {
    if (!add("registerService", {service, service_uri, uri})) return false;
  }
  for (const std::string& topic : subscriptions_) {
    if (!add("registerSubscriber", {topic, "*", uri})) return false;  // *: whatever is published
    // An empty list would end connections to publishers that have not registered again, but still send.
    if (payload.getType() == XmlRpcValue::TypeArray && payload.size() > 0) UpdatePublishers(topic, payload);
  }
  return true;
}

}  // namespace acmp
